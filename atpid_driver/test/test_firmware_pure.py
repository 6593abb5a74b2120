# SPDX-License-Identifier: Apache-2.0
"""The firmware's pure part on this machine, under the compiler's address and undefined-behaviour checks."""

import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"


@pytest.mark.slow
@pytest.mark.parametrize("run", ["", "11400000 99"])  # the second once left a target outside the limits
def test_every_rule_holds_for_random_requests_and_faults(tmp_path: Path, run: str) -> None:
    command = ["make", "-C", str(FIRMWARE), "check", f"BUILD={tmp_path}", f"RUN={run}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "every rule held" in done.stdout
