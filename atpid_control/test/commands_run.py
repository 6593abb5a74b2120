# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands run by tests: what they answer, and the one line in which they refuse."""

import json
from typing import Any

import pytest

from atpid_control.cli import main


def printed(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """Return what a command that succeeds prints; it has nothing to say on standard error."""
    assert main([str(word) for word in words]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    return output.out


def answered(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """Return the object that a command prints with --json, and nothing else."""
    found: dict[str, Any] = json.loads(printed(capsys, *words, "--json"))
    return found


def refusal(capsys: pytest.CaptureFixture[str], *words: object, status: int = 2) -> str:
    """Return the one line on standard error of a command that is refused."""
    assert main([str(word) for word in words]) == status
    output = capsys.readouterr()
    assert (output.out, output.err.count("\n")) == ("", 1)
    return output.err
