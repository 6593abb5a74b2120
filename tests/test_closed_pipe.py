# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Standard output or error closed early, as `head` does, or not open at all: the commands end quietly with a status
that depends neither on buffering nor on the version of argparse; another pipe that breaks is not hidden.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from atpid_common.cli import guarded

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
READINGS = "position,volts\n-0.1,1.7\n0.0,3.0\n0.05,3.7\n0.1,4.3\n"
COMMANDS = {
    "rich": "atpid simulate scenes/standard.yaml --fidelity impact",
    "control": "atpid bag verify bags/thesis_4_3_short",
    "driver": "atpid calibrate sensor {0}/readings.csv --channel x --sensor x --serial x --out {0}/made.yaml",
    "help": "atpid --help",
    "help of the driver": "atpid calibrate sensor --help",
}


#: Unbuffered it is the first print that fails, not the last flush: one command for each way to print.
ENDED = [(name, None) for name in COMMANDS] + [(name, "1") for name in ("driver", "rich", "help")]


def run(command: str, unbuffered: str | None, **streams: Any) -> subprocess.CompletedProcess[str]:
    """Run `command`, with PYTHONUNBUFFERED as given or not set."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    if unbuffered:
        environment["PYTHONUNBUFFERED"] = unbuffered
    words = command.split()
    return subprocess.run(words, cwd=ROOT, env=environment, text=True, check=False, **streams)


@pytest.fixture
def closed() -> Iterator[int]:
    """The writing end of a pipe whose reader has left."""
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


@pytest.mark.parametrize(("name", "unbuffered"), ENDED)
def test_a_command_whose_reader_left_ends_quietly(
    name: str, unbuffered: str | None, closed: int, tmp_path: Path
) -> None:
    (tmp_path / "readings.csv").write_text(READINGS)
    done = run(COMMANDS[name].format(tmp_path), unbuffered, stdout=closed, stderr=subprocess.PIPE)
    assert done.stderr == ""
    assert done.returncode == 1


@pytest.mark.parametrize("unbuffered", [None, "1"])
@pytest.mark.parametrize("command", ["atpid replay none", "atpid nothing", "atpid calibrate sensor"])
def test_an_error_line_into_a_closed_pipe_ends_the_same_way(command: str, unbuffered: str | None, closed: int) -> None:
    done = run(command, unbuffered, stdout=subprocess.PIPE, stderr=closed)
    assert (done.returncode, done.stdout) == (1, "")


@pytest.mark.parametrize("unbuffered", [None, "1"])
def test_an_error_line_where_both_pipes_are_closed_ends_the_same_way(unbuffered: str | None, closed: int) -> None:
    assert run("atpid nothing", unbuffered, stdout=closed, stderr=closed).returncode == 1


READ_ALL = """
import sys
from atpid_common.cli import guarded

def command():
    print("everything", flush=True)
    sys.stdin.readline()
    return 0

sys.exit(guarded(command))
"""


def test_a_reader_that_leaves_with_everything_has_missed_nothing() -> None:
    with subprocess.Popen([sys.executable, "-c", READ_ALL], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"everything\n"
        process.stdout.close()
        process.stdin.close()
        assert process.wait() == 0


@pytest.mark.parametrize(("command", "status"), [("atpid --help", 0), ("atpid replay none", 2)])
def test_without_standard_output_and_error_the_status_is_the_same(command: str, status: int) -> None:
    shell = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *command.split()]
    assert subprocess.run(shell, cwd=ROOT, check=False).returncode == status


def test_another_pipe_that_breaks_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> NoReturn:
        raise BrokenPipeError("a device's")

    with open(os.devnull, "w") as output:
        monkeypatch.setattr(sys, "stdout", output)
        with pytest.raises(BrokenPipeError, match="a device's"):
            guarded(broken)
