# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search of the packages against the thorough one, and the shipped map, which was made with the latter."""

from itertools import product
from pathlib import Path

import pytest

from atpid_sim.maps import DamperResponse, HeightMap, best_height
from atpid_sim.scene import Scene, load_scene
from studies.thorough_search import thorough_best

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "standard.yaml")


#: Left out: here better heights are reached only after longer irregular transients than either search waits for, and
#: rounding decides which of them finds one (docs/selection.md, what falls short).
LUCK = (0.2, 0.01)


@pytest.mark.parametrize(
    ("fraction", "amplitude"),
    [one for one in product((0.02, 0.1, 0.2, 0.3), (0.005, 0.01, 0.03, 0.07)) if one != LUCK],
)
def test_the_amplitude_is_at_most_four_parts_in_a_thousand_above_that_of_the_thorough_search(
    scene: Scene, fraction: float, amplitude: float
) -> None:
    damper = DamperResponse(scene.with_(mass_fraction=fraction), 1e-5)
    assert best_height(damper, amplitude).amplitude <= 1.004 * thorough_best(damper, amplitude).amplitude


def test_of_heights_equally_good_the_lowest_is_taken(scene: Scene) -> None:
    # at 2 mm the grain never reaches a ceiling above 43 mm: everything from there on is equally good
    assert thorough_best(DamperResponse(scene, 1e-5), 0.002).height == pytest.approx(0.0434, rel=0.01)


def test_the_shipped_map_is_what_the_thorough_search_finds(scene: Scene) -> None:
    shipped = HeightMap.load(ROOT / "atpid_control" / "config" / "maps" / "standard.npz")
    for row, column in ((0, 16), (0, 36), (1, 60), (2, 90)):
        fraction, amplitude = float(shipped.mass_fractions[row]), float(shipped.amplitudes[column])
        again = thorough_best(DamperResponse(scene.with_(mass_fraction=fraction), shipped.tolerance), amplitude, 0.15)
        assert again.height == pytest.approx(shipped.heights[row, column], rel=2e-3)
        assert again.amplitude == pytest.approx(shipped.beam_amplitudes[row, column], rel=2e-3)
