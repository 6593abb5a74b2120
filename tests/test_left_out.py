# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A test that CI leaves out is on the list of what it may leave out, or the run fails."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from left_out import ALLOWED

import atpid_common.testing

TESTS = Path(__file__).parent


def run(folder: Path, reason: str, ci: str, *more: str) -> "subprocess.CompletedProcess[str]":
    (folder / "test_one.py").write_text(f"import pytest\n\ndef test_it():\n    pytest.skip({reason!r})\n")
    (folder / "pytest.ini").write_text("[pytest]\n")
    command = [sys.executable, "-m", "pytest", "-p", "left_out", "-p", "no:cacheprovider", *more, str(folder)]
    environment = os.environ | {"CI": ci, "PYTHONPATH": f"{TESTS}:{os.environ.get('PYTHONPATH', '')}"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=300.0)


@pytest.mark.parametrize("workers", ["0", "1"])
def test_what_is_not_on_the_list_fails_in_ci(tmp_path: Path, workers: str) -> None:
    failed = run(tmp_path, "the moon is full", "true", "-n", workers)
    assert failed.returncode == 1, failed.stdout
    assert "which tests/left_out.py does not allow: the moon is full" in failed.stdout


@pytest.mark.parametrize(("reason", "ci"), [("the moon is full", ""), (next(iter(ALLOWED)), "true")])
def test_elsewhere_and_on_the_list_it_passes(tmp_path: Path, reason: str, ci: str) -> None:
    assert run(tmp_path, reason, ci, "-n", "0").returncode == 0


def test_every_reason_on_the_list_is_a_test_s() -> None:
    packages = ("*/test/*.py", "*/*/test/*.py")
    texts = [path.read_text(encoding="utf-8") for place in packages for path in TESTS.parent.glob(place)]
    texts += [path.read_text(encoding="utf-8") for path in TESTS.glob("*.py") if path.name != "left_out.py"]
    texts.append(Path(atpid_common.testing.__file__).read_text(encoding="utf-8"))
    assert [reason for reason in ALLOWED if not any(reason in text for text in texts)] == []
