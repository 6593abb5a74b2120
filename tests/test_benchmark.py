# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark measures each of its parts; how fast they are is no test."""

import os
import subprocess
from pathlib import Path

import pytest


@pytest.mark.slow
def test_each_part_has_a_ratio(root: Path) -> None:
    # what `make` runs, in an environment in which neither pytest nor an outer make has set anything
    given = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}
    listed = subprocess.run(
        ["make", "-n", "benchmark", "SECONDS=2"], cwd=root, env=given, capture_output=True, text=True, check=True
    )
    *_, recipe = listed.stdout.splitlines()
    done = subprocess.run(["sh", "-c", recipe], cwd=root, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    parts = [line.rsplit(maxsplit=3) for line in done.stdout.splitlines()[1:]]
    assert len({name for name, *_ in parts}) == 4
    assert all(float(number) > 0.0 for _, *numbers in parts for number in numbers)
