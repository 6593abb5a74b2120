# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Format, types and import rules: checks that run none of the project, beside the tests that do."""

import subprocess
from pathlib import Path

import numpy
import pytest


@pytest.mark.always("a change that one of these refuses is not complete")
@pytest.mark.parametrize(
    "command", ["ruff check .", "ruff format --check .", "mypy --strict", "lint-imports --no-logo"]
)
def test_it_passes(root: Path, command: str) -> None:
    if command.startswith("mypy") and numpy.lib.NumpyVersion(numpy.__version__) < "2.4.0":
        pytest.skip("an older numpy declares other types than are checked")
    done = subprocess.run(command.split(), cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
