# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/atlas.md shows what is computed now."""

import re

import pytest
from documented import ROOT

from atpid_sim.scene import standard_bench
from studies.atlas.column import column_of

ROW = re.compile(r"^\| (\d+) % \| (\d+) \| (.+) \|$", re.MULTILINE)
ROWS = ROW.findall((ROOT / "docs/atlas.md").read_text(encoding="utf-8"))


def test_the_table_has_its_rows() -> None:
    assert [(percent, millimetres) for percent, millimetres, _ in ROWS] == [
        ("5", "10"), ("5", "30"), ("10", "10"), ("10", "30"), ("20", "10"), ("20", "30"), ("30", "30"),
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("percent", "millimetres", "printed"), ROWS)
def test_best_heights_multipliers_and_cliffs_are_those_printed(percent: str, millimetres: str, printed: str) -> None:
    scene = standard_bench(grain={"mass_fraction": 0.01 * float(percent), "radius": 0.0085})
    column = column_of(scene, 1e-3 * float(millimetres), [0.1])
    best, stability = column.best, column.stability
    *numbers, loss = printed.split(" | ")
    height, efficiency, multiplier, cliff, distance, back = map(float, numbers)
    assert 1e3 * best.height == pytest.approx(height, abs=0.06)
    assert 100.0 * (1.0 - best.amplitude / column.closed) == pytest.approx(efficiency, abs=0.06)
    assert stability.largest == pytest.approx(multiplier, abs=1e-3)
    assert 1e3 * stability.cliff == pytest.approx(cliff, rel=1e-4, abs=0.06)
    assert 1e3 * (stability.cliff - best.height) == pytest.approx(distance, abs=0.06)
    assert 1e3 * (stability.cliff - stability.recovered) == pytest.approx(back, rel=0.02, abs=0.01)
    assert stability.loss.lower() == loss


def test_a_column_without_a_cliff_is_named() -> None:
    scene = standard_bench(grain={"mass_fraction": 0.3, "radius": 0.0085})
    assert column_of(scene, 0.01, [0.1]).stability.loss == "NONE"
