# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of users: whatever is wrong with one is a line, before memory is taken for it and without waiting."""

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.files import FileError, read_arrays, read_text

MOST = 1_000_000


def npz(**arrays: object) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def header_of(numbers: int) -> bytes:
    """Return an archive of an array that states so many numbers and has none."""
    stream, file = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (numbers,)})
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("time.npy", stream.getvalue())
    return file.getvalue()


GOOD = npz(time=np.arange(100.0), words=np.array(["a", "b"]), empty=np.zeros(0))


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "good.npz"
    path.write_bytes(GOOD)
    found = read_arrays(path, MOST)
    assert set(found) == {"time", "words", "empty"}
    np.testing.assert_array_equal(found["time"], np.arange(100.0))


@pytest.mark.parametrize("read", [read_text, read_arrays])
def test_a_pipe_a_device_a_folder_and_nothing_are_refused(read: Callable[[Path, int], object], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (
        (tmp_path / "pipe", "pipe"),
        (Path("/dev/zero"), "device"),
        (tmp_path, "folder"),
        (tmp_path / "none", "no such"),
        (Path("a\0b"), "no path"),
        (Path("x" * 5000), "too long"),
    ):
        with pytest.raises(FileError, match=reason):
            read(path, MOST)


def test_a_large_file_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(10**12)  # sparse
    monkeypatch.setattr(Path, "read_text", None)
    with pytest.raises(FileError, match=r"large: 1000000\.0 MB;.* 1 MB"):
        read_text(path, MOST)


def test_an_archive_that_unpacks_to_more_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "packed.npz"
    np.savez_compressed(path, time=np.zeros(1_000_000))
    assert path.stat().st_size < MOST
    monkeypatch.setattr(zipfile.ZipFile, "open", None)  # none of it is unpacked
    with pytest.raises(FileError, match=r"packed\.npz: 8\.0 MB .* 1 MB"):
        read_arrays(path, MOST)


@pytest.mark.parametrize(
    ("content", "reason"),
    [(header_of(10**15), "8000000000000000"), (npz(time=np.array([print, None])), "Python")],
    ids=["more stated than there is", "Python objects"],
)
def test_neither_memory_is_taken_nor_an_object_loaded(content: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.npz"
    path.write_bytes(content)
    with pytest.raises(FileError, match=rf"odd\.npz: .*time.*{reason}"):
        read_arrays(path, MOST)


@given(place=st.integers(0, len(GOOD) - 1), value=st.integers(0, 255), length=st.integers(0, len(GOOD)))
def test_a_changed_or_cut_archive_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, place: int, value: int, length: int
) -> None:
    changed = bytearray(GOOD)
    changed[place] = value
    path = tmp_path_factory.getbasetemp() / "changed.npz"
    for content in (bytes(changed), GOOD[:length]):
        path.write_bytes(content)
        problem = ""
        try:
            read_arrays(path, MOST)
        except FileError as error:
            problem = str(error)
        assert "\n" not in problem
