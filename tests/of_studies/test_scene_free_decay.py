# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The only real measurements there are: the free decays of thesis section 2.3.1."""

from pathlib import Path

import pytest

from atpid_sim.scene import load_scene
from studies.figures.free_decay import MEASURED, Measurement, decrements, draw, free_decay, table

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("case", MEASURED, ids=lambda case: f"{case.mass_fraction}-{case.height}")
def test_decrements_are_those_measured_on_the_stand(case: Measurement) -> None:
    largest = decrements(free_decay(case.mass_fraction, case.height)).max()
    if case.within is None:
        assert largest > case.decrement
    else:
        assert largest == pytest.approx(case.decrement, rel=case.within)


def test_the_closed_damper_decays_at_one_rate() -> None:
    ratios = decrements(free_decay(0.1, 0.017))
    assert ratios.max() / ratios.min() < 1.002


def test_the_scene_that_comes_along_is_the_one_that_is_compared() -> None:
    shipped = load_scene(ROOT / "scenes" / "free_decay.yaml").to_mapping()
    compared = free_decay(0.1, 0.2).to_mapping()
    assert shipped | {"steady_window": None} == compared | {"steady_window": None}


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    (file,) = draw(tmp_path)
    assert file.stat().st_size > 20_000
    assert (ROOT / "docs" / "figures" / file.name).is_file()


def test_the_documented_table_is_the_computed_one() -> None:
    assert table() in (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
