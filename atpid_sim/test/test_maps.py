# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Height maps: the thesis's best heights, the file, what it refuses, and the header for the firmware."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_sim.maps import (
    DamperResponse,
    EarlyEnd,
    Failure,
    HeightMap,
    MapError,
    Timing,
    best_height,
    build_map,
    header_text,
)
from atpid_sim.maps.ratings import FLAT
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, load_scene

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "atpid_control" / "config" / "maps" / "standard.npz"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "standard.yaml")


@pytest.fixture(scope="module")
def shipped() -> HeightMap:
    return HeightMap.load(SHIPPED)


@pytest.mark.parametrize(
    ("fraction", "amplitude", "height", "remaining"),
    [
        # brute force by an independent reference; thesis Figs 3.23 and 4.6
        (0.1, 0.015, 0.29, 0.20),
        (0.1, 0.03, 0.57, 0.19),
        (0.1, 0.04, 0.76, 0.19),
        (0.2, 0.03, 0.32, 0.11),
        (0.3, 0.03, 0.21, 0.10),
    ],
)
def test_best_heights_are_those_of_the_thesis(
    scene: Scene, fraction: float, amplitude: float, height: float, remaining: float
) -> None:
    best = best_height(DamperResponse(scene.with_(mass_fraction=fraction), 1e-5), amplitude)
    assert best.height == pytest.approx(height, rel=0.03)
    assert 1.0 - best.efficiency == pytest.approx(remaining, abs=0.006)
    assert best.reproducible


@pytest.mark.parametrize(("fraction", "amplitude"), [(0.1, 0.003), (0.1, 0.008), (0.3, 0.02), (0.05, 0.01)])
def test_no_height_of_a_fine_scan_is_notably_better(scene: Scene, fraction: float, amplitude: float) -> None:
    damper = DamperResponse(scene.with_(mass_fraction=fraction), 1e-5)
    best = best_height(damper, amplitude)
    unit = damper.ballistic_clearance(amplitude)
    scan = [
        damper.opened(amplitude, damper.diameter + share * unit, Timing(60, 16)) for share in np.arange(0.3, 1.0, 0.011)
    ]
    regular = [response.amplitude for response in scan if response.regular]
    assert damper.opened(amplitude, best.height, Timing(60, 16)).amplitude <= 1.015 * min(regular)


def test_of_heights_equally_good_the_lowest_is_taken(scene: Scene) -> None:
    # at 2 mm the grain never reaches a ceiling above 43 mm: everything from there on is equally good
    damper = DamperResponse(scene, 1e-5)
    best = best_height(damper, 0.002)
    assert best.height == pytest.approx(0.0434, rel=0.02)  # in steps of a hundredth
    above = damper.opened(0.002, 2.0 * best.height, Timing(60, 16)).amplitude
    assert above == pytest.approx(best.amplitude, rel=2 * FLAT)


def test_the_shipped_map_is_what_the_command_computes_now(scene: Scene, shipped: HeightMap) -> None:
    points = [(0, 16), (0, 36), (1, 60), (2, 60)]
    for row, column in points:
        fraction, amplitude = float(shipped.mass_fractions[row]), float(shipped.amplitudes[column])
        again = best_height(DamperResponse(scene.with_(mass_fraction=fraction), shipped.tolerance), amplitude, 0.15)
        # near the best the amplitude falls by as much as the height grows
        assert again.height == pytest.approx(shipped.heights[row, column], rel=0.015)
        assert again.amplitude == pytest.approx(shipped.beam_amplitudes[row, column], rel=2.5 * FLAT)


class Complete(DamperResponse):
    """A response whose search takes no cheaper level."""

    def sufficient(self, amplitude: float, error: float) -> DamperResponse:
        del amplitude, error
        return self


class Coarse(DamperResponse):
    """A response whose search takes a level that is not sufficient."""

    def sufficient(self, amplitude: float, error: float) -> DamperResponse:
        del amplitude, error
        return DamperResponse(self._integration.scene, fidelity="impact")


@pytest.mark.parametrize(("fraction", "amplitude"), [(0.1, 0.01), (0.2, 0.03), (0.3, 0.05)])
def test_the_quick_search_finds_what_the_complete_one_does(scene: Scene, fraction: float, amplitude: float) -> None:
    heavy = scene.with_(mass_fraction=fraction)
    quick, complete = (best_height(kind(heavy, 1e-5), amplitude) for kind in (DamperResponse, Complete))
    assert (quick.searched, quick.checked) == ("finite", "soft")
    assert (complete.searched, complete.checked) == ("soft", "soft")
    assert quick.disagreement <= FLAT
    assert quick.amplitude == pytest.approx(complete.amplitude, rel=2 * FLAT)


def test_a_check_that_disagrees_is_announced_and_the_search_goes_on(scene: Scene) -> None:
    # contacts of a soft grain last so long that without their duration the cliff lies elsewhere
    soft = scene.with_(contact=scene.contact.model_dump(exclude_none=True) | {"young_modulus": 2e7})
    best, complete = (best_height(kind(soft, 1e-5), 0.01) for kind in (Coarse, Complete))
    assert (best.searched, best.checked) == ("impact", "soft")
    assert best.disagreement > FLAT
    assert best.amplitude <= (1.0 + 0.02) * complete.amplitude


def test_a_run_that_settles_ends_early_and_comes_to_the_same(scene: Scene) -> None:
    damper, timing = DamperResponse(scene, 1e-6), Timing(120.0, 16.0)
    whole = damper.opened(0.01, 0.15, timing)
    state = damper.closed_state(0.01)
    early = damper.follow_on(0.01, state, ((0.0, 0.15),), timing, EarlyEnd(1e-3))
    assert early.amplitude == pytest.approx(whole.amplitude, rel=1e-3)
    assert early.regular
    assert state.time < 100.0 * damper.period


def test_a_run_above_its_limit_ends_early(scene: Scene) -> None:
    damper, timing = DamperResponse(scene, 1e-6), Timing(120.0, 16.0)
    state = damper.closed_state(0.01)
    response = damper.follow_on(0.01, state, ((0.0, 0.08),), timing, EarlyEnd(limit=0.05))
    assert response.exceeded
    assert response.amplitude > 0.05
    assert state.time < 40.0 * damper.period


def test_a_run_in_one_kernel_is_that_through_a_drive_table(scene: Scene) -> None:
    damper, path, timing = DamperResponse(scene, 1e-8), ((0.0, 0.017), (1.0, 0.15)), Timing(30.0, 16.0)
    table = damper.follow(0.01, path, timing)
    kernel = damper.follow_on(0.01, damper.closed_state(0.01), path, timing)
    assert kernel.amplitude == pytest.approx(table.amplitude, rel=1e-6)
    assert kernel.variation == pytest.approx(table.variation, abs=1e-6)


def test_the_shipped_map_covers_the_bench(scene: Scene, shipped: HeightMap) -> None:
    shipped.check(scene)
    assert len(shipped.amplitudes) == 101
    assert list(shipped.mass_fractions) == [0.1, 0.2, 0.3]
    for amplitude, height in ((0.015, 0.29), (0.04, 0.76), (0.03, 0.57)):
        entry = shipped.lookup(amplitude, 0.1)
        assert entry.height == pytest.approx(height, rel=0.03)
        assert 1.0 - entry.efficiency < 0.21


@settings(deadline=None, max_examples=60)
@given(a=st.floats(0.002, 0.08), b=st.floats(0.002, 0.08), fraction=st.floats(0.1, 0.3))
def test_between_its_points_the_map_stays_between_their_values(a: float, b: float, fraction: float) -> None:
    stored = HeightMap.load(SHIPPED)
    for amplitude in (a, b):
        k = int(np.clip(np.searchsorted(stored.amplitudes, amplitude) - 1, 0, len(stored.amplitudes) - 2))
        rows = stored.heights[:, k : k + 2]
        assert rows.min() - 1e-12 <= stored.lookup(amplitude, fraction).height <= rows.max() + 1e-12


def test_a_map_is_read_back_as_it_was_written(scene: Scene, tmp_path: Path) -> None:
    made = build_map(scene, [0.01, 0.02], [0.1, 0.3], tmp_path / "map.npz")
    again = HeightMap.load(tmp_path / "map.npz")
    assert np.array_equal(again.heights, made.heights)
    assert again.identity == made.identity
    assert again.tolerance == made.tolerance
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]
    halfway = again.lookup(0.015, 0.2)
    assert again.lookup(0.015, 0.3).height < halfway.height < again.lookup(0.015, 0.1).height


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"beam": {"mass": 0.3258, "stiffness": 117.6, "damping": 0.56}}, "beam.stiffness 427.6 and not 117.6"),
        ({"grain": {"mass_fraction": 0.1, "radius": 0.005}}, "grain.radius 0.0085 and not 0.005"),
        ({"contact": {"law": "impact", "restitution": 0.15}}, "contact.law tsuji and not impact"),
        ({"gravity": 0.0}, "gravity 9.81 and not 0"),
        ({"frequency": 5.0}, "excitation.frequency resonance and not 5"),
        ({"mass_fraction": 0.05}, "mass fraction 0.05 is outside its 0.1 to 0.3"),
    ],
)
def test_a_map_for_another_system_is_refused(
    scene: Scene, shipped: HeightMap, change: dict[str, Any], named: str
) -> None:
    with pytest.raises(MapError, match=re.escape(named)) as caught:
        shipped.check(scene.with_(**change))
    assert "\n" not in str(caught.value)


def test_resonance_given_as_a_number_is_resonance(scene: Scene, shipped: HeightMap) -> None:
    shipped.check(scene.with_(frequency=scene.natural_frequency_hz))


@pytest.mark.parametrize("amplitude", [0.0019, 0.0801, -0.01, float("nan"), float("inf")])
def test_an_amplitude_out_of_the_map_is_refused(shipped: HeightMap, amplitude: float) -> None:
    with pytest.raises(MapError, match=r"outside its 0\.002 to 0\.08 m"):
        shipped.lookup(amplitude, 0.1)


@pytest.mark.parametrize(
    ("name", "change"),
    [("heights", lambda one: one[:, ::-1]), ("beam_amplitudes", lambda one: one[:, ::-1]),
     ("efficiencies", lambda one: one[:, ::-1]), ("efficiencies", lambda one: -one)],
    ids=["heights reversed", "beam amplitudes reversed", "efficiencies reversed", "efficiencies negative"],
)  # fmt: skip
def test_a_map_in_another_order_is_refused(
    name: str, change: Callable[[Any], Any], shipped: HeightMap, tmp_path: Path
) -> None:
    replace(shipped, **{name: change(getattr(shipped, name))}).save(tmp_path / "map.npz")
    with pytest.raises(MapError, match=r"map\.npz: its heights fall .*, or its efficiencies are not those") as refused:
        HeightMap.load(tmp_path / "map.npz")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("end", [0.002, 0.08])
def test_the_ends_of_the_map_belong_to_it_however_they_are_rounded(shipped: HeightMap, end: float) -> None:
    for near in (end * (1.0 - 2.0**-50), end * (1.0 + 2.0**-50)):
        assert shipped.lookup(near, 0.1) == shipped.lookup(end, 0.1)


@pytest.mark.parametrize("content", [b"", b"no map\n", b"PK\x03\x04torn"])
def test_a_file_that_is_no_map_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "map.npz"
    path.write_bytes(content)
    with pytest.raises(MapError, match="is no NPZ archive of arrays") as caught:
        HeightMap.load(path)
    assert "\n" not in str(caught.value)


def test_a_missing_map_and_one_of_another_format_are_refused(shipped: HeightMap, tmp_path: Path) -> None:
    with pytest.raises(MapError, match="no such file"):
        HeightMap.load(tmp_path / "none.npz")
    with np.load(SHIPPED) as stored:
        grids = {key: stored[key] for key in stored.files}
    np.savez(tmp_path / "old.npz", **{**grids, "about": np.array('{"format": 0}')})
    with pytest.raises(MapError, match="has map format 0"):
        HeightMap.load(tmp_path / "old.npz")
    np.savez(tmp_path / "holes.npz", **{**grids, "heights": grids["heights"] * np.nan})
    with pytest.raises(MapError, match="no whole grid"):
        HeightMap.load(tmp_path / "holes.npz")


def test_impossible_grids_are_refused(scene: Scene, tmp_path: Path) -> None:
    for amplitudes in ([0.01], [0.02, 0.01], [0.0, 0.01], [float("nan"), 0.01]):
        with pytest.raises(MapError, match="amplitudes: given"):
            build_map(scene, amplitudes, [0.1], tmp_path / "map.npz")
    with pytest.raises(MapError, match="mass fraction"):
        build_map(scene, [0.01, 0.02], [1.5], tmp_path / "map.npz")


def test_the_header_holds_the_map_in_micrometres(shipped: HeightMap) -> None:
    text = header_text(shipped, 0.1)
    found = re.search(r"ATPID_TABLE_N (\d+)", text)
    assert found is not None
    count = int(found[1])
    columns = {name: _numbers(text, name) for name in ("atpid_amplitude_um", "atpid_height_um")}
    assert count == 101 == len(columns["atpid_amplitude_um"]) == len(columns["atpid_height_um"])
    assert columns["atpid_amplitude_um"][0] == 2000
    assert columns["atpid_amplitude_um"][-1] == 80000
    for amplitude_um, height_um in zip(*columns.values(), strict=True):
        height = shipped.lookup(amplitude_um * 1e-6, 0.1).height
        assert 0.0 <= height * 1e6 - height_um + 50.0 <= 100.0


def _numbers(text: str, name: str) -> list[int]:
    found = re.search(rf"uint32_t {name}\[ATPID_TABLE_N\] PROGMEM = \{{([^}}]*)\}};", text)
    assert found is not None
    return [int(part) for part in found[1].split(",")]


@pytest.fixture(scope="module")
def gap(shipped: HeightMap) -> HeightMap:
    """The shipped map without its points at 40.04 and 41.6 mm, 10 % of grain."""
    missing = [int(np.argmin(np.abs(shipped.amplitudes - a))) for a in (0.04004, 0.0416)]
    grids = {name: getattr(shipped, name).copy() for name in ("heights", "beam_amplitudes", "efficiencies")}
    for grid in grids.values():
        grid[0, missing] = np.nan
    failures = tuple(Failure(0.1, float(shipped.amplitudes[k]), "too deep") for k in missing)
    return replace(shipped, **grids, failures=failures)


def test_a_point_without_a_height_is_kept_with_its_reason(gap: HeightMap, tmp_path: Path) -> None:
    gap.save(tmp_path / "gap.npz")
    again = HeightMap.load(tmp_path / "gap.npz")
    assert again.failures == gap.failures
    assert np.array_equal(again.heights, gap.heights, equal_nan=True)


def test_between_points_of_which_one_is_missing_there_is_no_height(gap: HeightMap, shipped: HeightMap) -> None:
    for amplitude in (0.0395, 0.04004, 0.0408, 0.042):
        with pytest.raises(MapError, match=r"could not be computed \(too deep\)") as caught:
            gap.lookup(amplitude, 0.1)
        assert "\n" not in str(caught.value)
    with pytest.raises(MapError, match="could not be computed"):
        gap.lookup(0.0408, 0.15)
    assert gap.lookup(0.0408, 0.2) == shipped.lookup(0.0408, 0.2)  # that row is whole
    assert gap.lookup(0.02, 0.1) == shipped.lookup(0.02, 0.1)
    assert gap.covers(0.002, 0.039, 0.1)
    assert gap.covers(0.043, 0.08, 0.1)
    assert gap.covers(0.002, 0.08, 0.3)
    assert not gap.covers(0.002, 0.08, 0.1)
    assert not gap.covers(0.001, 0.02, 0.1)


def test_the_firmware_s_table_has_a_height_that_is_refused_where_there_is_none(gap: HeightMap) -> None:
    text = header_text(gap, 0.1)
    heights = _numbers(text, "atpid_height_um")
    assert heights.count(0) == 2
    assert len(heights) == 101
    assert "could not be computed (2 amplitudes)" in text
    assert "could not be computed" not in header_text(gap, 0.3)


def test_a_hole_without_a_reason_is_damage(gap: HeightMap, tmp_path: Path) -> None:
    replace(gap, failures=gap.failures[:1]).save(tmp_path / "torn.npz")
    with pytest.raises(MapError, match="no whole grid"):
        HeightMap.load(tmp_path / "torn.npz")


def test_a_map_of_which_no_point_can_be_computed_is_a_failure(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(
        NumericalFailure, match="none of the 2 points of the map can be computed: the grain was pressed"
    ):
        build_map(scene, [0.3, 0.4], [0.1], tmp_path / "map.npz")
