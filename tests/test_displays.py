# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What takes long moves on a terminal, on standard error only, and prints nothing of the kind anywhere else."""

import json
import os
import pty
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from atpid_control.cli import main as atpid
from studies.cli import main as studies

pytestmark = pytest.mark.slow

COMMANDS: dict[str, tuple[Callable[[list[str]], int], list[str]]] = {
    "heights": (studies, ["sweep", "--points", "2"]),
    "simulating": (atpid, ["simulate", "scenes/standard.yaml", "--json"]),
    "repeating its stages": (atpid, ["bag", "report", "bags/thesis_4_3_short", "--out", "OUT"]),
}


def run(text: str, out: Path) -> int:
    main, words = COMMANDS[text]
    return main([str(out) if word == "OUT" else word for word in words])


@pytest.fixture(autouse=True)
def _at_the_root(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")


@pytest.mark.parametrize("text", COMMANDS)
def test_a_display_moves_on_a_terminal(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    terminal, end = pty.openpty()
    shown: list[bytes] = []

    def read() -> None:
        try:
            while piece := os.read(terminal, 4096):
                shown.append(piece)
        except OSError:  # the other end is closed
            pass

    reader = threading.Thread(target=read)
    reader.start()
    try:
        with os.fdopen(end, "w") as stderr:
            monkeypatch.setattr("sys.stderr", stderr)
            status = run(text, tmp_path / "out")
            monkeypatch.undo()
    finally:
        reader.join()
        os.close(terminal)
    assert status == 0
    assert text.encode() in b"".join(shown)
    assert b"\x1b[" in b"".join(shown)
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("text", COMMANDS)
def test_without_a_terminal_there_is_none(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(text, tmp_path / "out") == 0
    out, errors = capsys.readouterr()
    assert errors == ""
    if text != "repeating its stages":
        json.loads(out)
