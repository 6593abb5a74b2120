# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Format, types and import rules: checks that run none of the project, beside the tests that do."""

import subprocess
import sys
from pathlib import Path

import numpy
import pytest

always = pytest.mark.always("a change that one of these refuses is not complete")


def passes(root: Path, *words: str) -> None:
    done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@always
def test_style(root: Path) -> None:
    passes(root, "ruff", "check", ".")


@always
def test_format(root: Path) -> None:
    passes(root, "ruff", "format", "--check", ".")


@always
@pytest.mark.skipif(
    numpy.lib.NumpyVersion(numpy.__version__) < "2.4.0", reason="an older numpy declares other types than are checked"
)
def test_types(root: Path) -> None:
    passes(root, sys.executable, "-m", "mypy", "--strict")


@always
def test_import_rules(root: Path) -> None:
    passes(root, "lint-imports", "--no-logo")
