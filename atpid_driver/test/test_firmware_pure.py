# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The firmware's pure part on this machine, under the compiler's address and undefined-behaviour checks."""

import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"


#: Of the storm, a million requests of any number.
STORM = "4000000 5 2"


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that all runs are built in, once."""
    return tmp_path_factory.mktemp("firmware")


@pytest.mark.slow
@pytest.mark.parametrize("run", ["", "11400000 99", STORM])  # the second once left a target outside the limits
def test_every_rule_holds_for_random_requests_and_faults(build: Path, run: str) -> None:
    command = ["make", "-C", str(FIRMWARE), "check", f"BUILD={build}", f"RUN={run}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-2 if "Leaving" in done.stdout else -1]
    assert "every rule held" in last
    assert run != STORM or int(last.split()[0]) > 1_000_000
