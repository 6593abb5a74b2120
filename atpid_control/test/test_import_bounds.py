# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that state, or unpack to, more than they hold are refused by what they state, before memory is taken."""

import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.import_files import import_files
from atpid_control.runs.imports.series import Given, mapped
from atpid_control.runs.run import open_run

MISSING = "h5py is missing: make import"
HUGE = 10**9


def columns_of_hdf5(path: Path) -> None:
    """Write 2 kB that state two columns of 8 GB."""
    h5py = pytest.importorskip("h5py", reason=MISSING)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("time", "beam"):
            file.create_dataset(name, shape=(1, HUGE), dtype="f8")


def chunk_of_hdf5(path: Path) -> None:
    """Write 50 numbers in a packed chunk of 2 GB."""
    h5py = pytest.importorskip("h5py", reason=MISSING)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["fs"] = [[10.0]]
        file.create_dataset("beam", (1, 50), "f8", chunks=(1, HUGE // 4), maxshape=(1, None), compression="gzip")


def text_of_hdf5(path: Path) -> None:
    """Write a struct whose unit is a text of 2 GB."""
    h5py = pytest.importorskip("h5py", reason=MISSING)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["run/fs"], file["run/beam"] = [[10.0]], np.zeros((1, 50))
        unit = file.create_dataset("run/units/beam", (HUGE, 1), "u2")
        unit.attrs["MATLAB_class"] = np.bytes_("char")


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def column_of_matlab_5(path: Path) -> None:
    """Write a packed column that states 2 GB, of which nothing is there."""
    rows = HUGE // 4
    about = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", rows, 1)) + element(1, b"beam")
    inside = about + struct.pack("<II", 9, 8 * rows)
    packed = zlib.compress(struct.pack("<II", 14, len(about) + 8 * rows) + inside)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def wav(path: Path, bits: int) -> None:
    """Write 300 bytes of samples where 4 GB are stated."""
    about = struct.pack("<HHIIHH", 1, 1, 8000, 1000 * bits, bits // 8, bits)
    length = struct.pack("<I", 2**32 - 48)
    path.write_bytes(b"RIFF" + length + b"WAVE" + b"fmt " + struct.pack("<I", 16) + about + b"data" + length)
    path.write_bytes(path.read_bytes() + bytes(300))


BEYOND: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "columns of MATLAB 7.3": (".mat", columns_of_hdf5, "2e+09 numbers in 0.00218 MB: more than it can hold"),
    "a chunk of MATLAB 7.3": (".mat", chunk_of_hdf5, "2.5e+08 numbers in 0.00"),
    "a text of MATLAB 7.3": (".mat", text_of_hdf5, "1e+09 numbers in 0.00"),
    "a column of MATLAB 5": (".mat", column_of_matlab_5, "2.5e+08 numbers in 0.000"),
    "samples of 16 bits": (".wav", lambda path: wav(path, 16), "mmap length is greater than file size"),
    "samples of 24 bits": (".wav", lambda path: wav(path, 24), "Reached EOF prematurely"),
}


@pytest.mark.parametrize("name", BEYOND)
def test_what_states_more_than_it_holds_takes_no_memory(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ending, write, reason = BEYOND[name]
    path = tmp_path / f"a{ending}"
    write(path)
    tracemalloc.start()
    status = main(["bag", "import", str(path), "--out", str(tmp_path / "bag")])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    error = capsys.readouterr().err
    assert (status, reason in error, error.count("\n")) == (2, True, 1), error
    assert most < 60e6
    assert list(tmp_path.iterdir()) == [path]


def test_pieces_that_come_to_more_than_their_file_are_refused(tmp_path: Path) -> None:
    path, given = tmp_path / "a.csv", Given(tmp_path)
    path.write_bytes(bytes(1000))
    assert len(mapped(path, given, [np.zeros(100_000)])) == 100_000
    with pytest.raises(BagError, match=r"1.5e\+05 numbers in 0.001 MB: more than it can hold"):
        mapped(path, given, [np.zeros(100_000), np.zeros(50_000)])


RECORD = """    -1
    58
beam
none
none
none
none
    1         0    0         0 a                  1   3 b                  0   0
         4         3         1 {begin:12.5e} 1.00000e-07  0.00000e+00
        17    0    0    0 NONE                 s
         8    0    0    0 beam                 m
         0    0    0    0 NONE                 NONE
         0    0    0    0 NONE                 NONE
  1.000000000000e+00  2.000000000000e+00  3.000000000000e+00
    -1
"""


def test_records_far_apart_are_not_filled(tmp_path: Path) -> None:
    """Half a second at 10 MHz would be 40 MB, 500 seconds 40 GB."""
    path = tmp_path / "a.uff"
    path.write_text(RECORD.format(begin=0.0) + RECORD.format(begin=500.0))
    import_files([path], tmp_path / "bag", [])
    found = open_run(tmp_path / "bag")
    assert list(found.signal("beam").values) == [1.0, 2.0, 3.0]
    assert list(found.signal("beam_1").values) == [1.0, 2.0, 3.0]
