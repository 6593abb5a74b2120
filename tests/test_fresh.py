# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Property tests with fresh examples: a part of them in each run, and what fails is kept and tried again."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fresh import ROOT, property_tests

FRESH = ROOT / "tests/fresh.py"
#: Long enough for one test at least on a busy machine; `make fresh` is the bulk.
SECONDS = 10.0

LOTTERY = """
from hypothesis import given, strategies as st

@given(st.integers())
def test_no_number_is_large(number):
    assert abs(number) < 1000
"""


def fresh(*words: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(FRESH), *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=550.0)


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("CI"), reason="left to chance: in CI only; `make fresh`")
def test_fresh_examples_of_the_property_tests_pass() -> None:
    done = fresh(SECONDS)
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-2000:]
    words = done.stdout.splitlines()[-1].split()
    assert words[:2] == ["fresh", "examples:"]
    assert int(words[2]) >= 1, "on a busy machine"


def test_the_files_with_property_tests_are_found() -> None:
    names = {path.name for path in property_tests()}
    assert {"test_supervision.py", "test_scene.py", "test_step_back.py"} <= names
    assert len(names) > 20


def test_an_example_that_fails_is_printed_kept_and_tried_again(tmp_path: Path) -> None:
    path, kept = tmp_path / "test_lottery.py", tmp_path / "examples"
    path.write_text(LOTTERY)
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = -p atpid_common.testing\n")
    code = "import fresh, sys; path, kept = map(fresh.Path, sys.argv[1:]); sys.exit(fresh.run(60.0, [path], kept))"
    command = [sys.executable, "-c", code, str(path), str(kept)]
    for _ in range(2):
        done = subprocess.run(command, cwd=FRESH.parent, capture_output=True, text=True, check=False, timeout=300.0)
        assert done.returncode == 1, done.stdout + done.stderr
        assert "number=1000" in done.stdout.replace("-", "")
        assert "@reproduce_failure" in done.stdout
    assert [file for file in kept.rglob("*") if file.is_file()]
