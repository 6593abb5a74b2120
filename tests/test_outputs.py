# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What cannot be written: a place, a full disk, a closed pipe or stream ends a command with its status and one line."""

import errno
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from documented import ROOT

from atpid_common.cli import guarded
from atpid_common.output import OutputError, file, folder, writing
from atpid_sim.maps import HeightMap


def test_files_and_folders_that_are_the_other(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file: .* file; .* --out"):
        folder(tmp_path / "file")
    with pytest.raises(OutputError, match=r" folder; .* --series"):
        file(tmp_path, "--series")
    with pytest.raises(OutputError, match=r"below: .*/file\b.* file; .* --out"):
        file(tmp_path / "file" / "below")
    with pytest.raises(OutputError, match=os.strerror(errno.ENOENT)), writing(tmp_path / "x"):
        (tmp_path / "none" / "x").write_text("")
    assert folder(tmp_path / "a" / "b").is_dir()
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_disk_that_fills_up_costs_no_point_of_a_map(tmp_path: Path) -> None:
    """A file that may not grow stands for the full disk: the same command goes on from what is in the journal."""
    out = tmp_path / "map.npz"
    command = ["atpid", "map", str(ROOT / "scenes/standard.yaml")]
    command += ["--amplitudes", "0.01:0.012:12", "--mass-fractions", "0.1", "--out", str(out)]
    # first in another file, so that the kernels are compiled: they are kept in files as well
    subprocess.run([*command[:-1], str(tmp_path / "first.npz")], capture_output=True, check=True)
    full = subprocess.run(["sh", "-c", 'ulimit -f 2; exec "$@"', "sh", *command], capture_output=True, text=True)
    assert full.returncode == 2
    assert "Traceback" not in full.stderr
    assert full.stderr.splitlines()[-1].startswith("error: ")
    journal = Path(f"{out}.journal")
    kept = journal.read_bytes().count(b"\n") - 1
    assert 0 < kept < 12
    assert not out.exists()
    subprocess.run(command, capture_output=True, check=True)
    assert HeightMap.load(out).heights.shape == (1, 12)
    assert not journal.exists()


COMMANDS = {
    "rich": "atpid simulate scenes/standard.yaml --fidelity impact",
    "control": "atpid bag check bags/thesis_4_3_short",
    "help": "atpid --help",
}
#: Unbuffered it is the first print that fails, not the last flush: one command for each way to print.
ENDED = [(name, None) for name in COMMANDS] + [(name, "1") for name in ("rich", "help")]
PRINTING = (
    "import sys; from atpid_common.cli import guarded; sys.exit(guarded(lambda: print('everything', flush=True) or 0))"
)


def run(words: list[str], unbuffered: str | None, **streams: Any) -> subprocess.CompletedProcess[str]:
    """Run a command, with PYTHONUNBUFFERED as given or not set."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    if unbuffered:
        environment["PYTHONUNBUFFERED"] = unbuffered
    return subprocess.run(words, cwd=ROOT, env=environment, text=True, check=False, **streams)


@pytest.fixture
def closed() -> Iterator[int]:
    """The writing end of a pipe whose reader has left."""
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


@pytest.mark.parametrize(("name", "unbuffered"), ENDED)
def test_a_command_whose_reader_left_ends_quietly(name: str, unbuffered: str | None, closed: int) -> None:
    done = run(COMMANDS[name].split(), unbuffered, stdout=closed, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize("unbuffered", [None, "1"])
def test_an_error_line_into_a_closed_pipe_ends_the_same_way(unbuffered: str | None, closed: int) -> None:
    for line in ("atpid replay none", "atpid nothing"):
        done = run(line.split(), unbuffered, stdout=subprocess.PIPE, stderr=closed)
        assert (done.returncode, done.stdout) == (1, "")
    assert run(["atpid", "nothing"], unbuffered, stdout=closed, stderr=closed).returncode == 1


@pytest.mark.parametrize("unbuffered", [None, "1"])
def test_standard_output_on_a_full_disk_is_one_line(unbuffered: str | None) -> None:
    with open("/dev/full", "wb") as full:
        done = run([sys.executable, "-c", PRINTING], unbuffered, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert re.fullmatch(f"error: .*{os.strerror(errno.ENOSPC)}\n", done.stderr)


@pytest.mark.parametrize(("command", "status"), [("atpid --help", 0), ("atpid replay none", 2)])
def test_without_standard_output_and_error_the_status_is_the_same(command: str, status: int) -> None:
    shell = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *command.split()]
    assert subprocess.run(shell, cwd=ROOT, check=False).returncode == status


def test_another_pipe_that_breaks_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> NoReturn:
        raise BrokenPipeError("of a device")

    with open(os.devnull, "w") as output:
        monkeypatch.setattr(sys, "stdout", output)
        with pytest.raises(BrokenPipeError, match="device"):
            guarded(broken)
