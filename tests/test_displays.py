# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What takes long moves on a terminal, on standard error only, and prints nothing of the kind anywhere else."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from atpid_control.cli import main as atpid
from studies.cli import main as studies

COMMANDS: dict[str, tuple[Callable[[list[str]], int], list[str]]] = {
    "heights": (studies, ["sweep", "--points", "2"]),
    "simulating": (atpid, ["simulate", "scenes/standard.yaml", "--json"]),
    "repeating its stages": (atpid, ["bag", "report", "bags/thesis_4_3_short", "--out", "OUT"]),
}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("text", COMMANDS)
def test_a_display_moves_on_a_terminal_and_nowhere_else(
    text: str, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root)
    monkeypatch.setenv("TERM", "xterm")
    main, words = COMMANDS[text]
    monkeypatch.setenv("COLUMNS", "120")

    def run(out: Path) -> int:
        return main([str(out) if word == "OUT" else word for word in words])

    with monkeypatch.context() as change:
        terminal = Terminal()
        change.setattr("sys.stderr", terminal)
        assert run(tmp_path / "first") == 0
    assert text in terminal.getvalue()
    assert "\x1b[" in terminal.getvalue()
    assert "\x1b" not in capsys.readouterr().out
    assert run(tmp_path / "second") == 0  # without a terminal
    out, errors = capsys.readouterr()
    assert errors == ""
    if "OUT" not in words:
        json.loads(out)
