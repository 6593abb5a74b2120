# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark measures each of its parts; how fast they are is no test."""

import math
from pathlib import Path

import pytest
from benchmark import parts


@pytest.mark.slow
def test_each_part_has_a_ratio(tmp_path: Path) -> None:
    measured = parts(tmp_path, 2.0)
    assert len({part.name for part in measured}) == 4
    for part in measured:
        assert part.real > 0.0
        assert math.isfinite(part.ratio)
        assert part.ratio > 0.0
