# SPDX-License-Identifier: Apache-2.0
"""A reader that leaves early, as `head` does: the commands end quietly; another pipe that breaks is not hidden."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from atpid_common.cli import guarded

ROOT = Path(__file__).resolve().parent.parent
READINGS = "position,volts\n-0.1,1.7\n0.0,3.0\n0.05,3.7\n0.1,4.3\n"
COMMANDS = {
    "plain": "atpid_sim simulate scenes/standard.yaml --fidelity impact --json",
    "rich": "atpid_sim simulate scenes/standard.yaml --fidelity impact",
    "control": "atpid_control select scenes/thesis_4_3.yaml --method pca --json",
    "driver": "atpid_driver calibrate {0}/readings.csv --channel x --sensor x --serial x --out {0}/made.yaml",
    "help": "atpid_sim --help",
    "help of the driver": "atpid_driver calibrate --help",
}


def without_a_reader(command, both=False, **environment):
    """Run `python -m command` with a standard output nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        return subprocess.run(
            [sys.executable, "-m", *command.split()], cwd=ROOT, env=os.environ | environment, text=True, check=False,
            stdout=writing, stderr=subprocess.STDOUT if both else subprocess.PIPE, timeout=100.0,
        )  # fmt: skip
    finally:
        os.close(writing)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_whose_reader_left_ends_quietly(name, unbuffered, tmp_path):
    (tmp_path / "readings.csv").write_text(READINGS)
    done = without_a_reader(COMMANDS[name].format(tmp_path), PYTHONUNBUFFERED=unbuffered)
    assert done.stderr == ""
    assert done.returncode == 1


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_an_error_line_into_a_closed_pipe_ends_the_same_way(unbuffered):
    command = "atpid_sim simulate none.yaml"
    assert without_a_reader(command, both=True, PYTHONUNBUFFERED=unbuffered).returncode == 1


def test_another_pipe_that_breaks_is_not_hidden(monkeypatch):
    def broken():
        raise BrokenPipeError("a device's")

    with open(os.devnull, "w") as output, pytest.raises(BrokenPipeError, match="a device's"):
        monkeypatch.setattr(sys, "stdout", output)
        guarded(broken)
