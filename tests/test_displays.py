# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What takes long moves on a terminal, on standard error only, and prints nothing of the kind anywhere else."""

import json
import os
import pty
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

COMMANDS = {
    "heights": ["python", "-m", "studies", "sweep", "--points", "2"],
    "simulating": ["atpid", "simulate", "scenes/standard.yaml", "--json"],
    "repeating its stages": ["atpid", "bag", "report", "bags/thesis_4_3_short", "--out", "OUT"],
}


def run(command: list[str], out: Path, root: Path, stderr: int) -> subprocess.Popen[str]:
    words = [str(out) if word == "OUT" else word for word in command]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    return subprocess.Popen(words, cwd=root, stdout=subprocess.PIPE, stderr=stderr, text=True, env=environment)


@pytest.mark.parametrize("text", COMMANDS)
def test_a_display_moves_on_a_terminal(text: str, root: Path, tmp_path: Path) -> None:
    terminal, end = pty.openpty()
    process = run(COMMANDS[text], tmp_path / "out", root, end)
    os.close(end)
    shown = b""
    while True:
        try:
            piece = os.read(terminal, 4096)
        except OSError:  # the other end is closed: the process has ended
            break
        shown += piece
        if not piece:
            break
    os.close(terminal)
    out, _ = process.communicate()
    assert process.returncode == 0
    assert text.encode() in shown
    assert b"\x1b[" in shown
    assert "\x1b" not in out


@pytest.mark.parametrize("text", COMMANDS)
def test_without_a_terminal_there_is_none(text: str, root: Path, tmp_path: Path) -> None:
    process = run(COMMANDS[text], tmp_path / "out", root, subprocess.PIPE)
    out, errors = process.communicate()
    assert process.returncode == 0
    assert errors == ""
    if text != "repeating its stages":
        json.loads(out)
