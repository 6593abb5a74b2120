# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Height maps over amplitude, mass fraction and frequency: best heights, search, file, look-up, resumption, header."""

import fcntl
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import PchipInterpolator
from sim_refusals import refused

from atpid_sim.maps import (
    FROM_CLOSED,
    Best,
    DamperResponse,
    EarlyEnd,
    Failure,
    HeightMap,
    MapError,
    Timing,
    best_height,
    build,
    build_map,
    header_text,
)
from atpid_sim.maps.curves import monotone
from atpid_sim.maps.ratings import FLAT, at_once, later
from atpid_sim.maps.response import LEAST_USE
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.simulation.batch import JournalError
from atpid_sim.simulation.integration import amplitude_without_damper

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
        (0.1, 0.015, 0.29, 0.20),
        (0.1, 0.03, 0.57, 0.19),
        (0.1, 0.04, 0.76, 0.19),
        (0.2, 0.03, 0.32, 0.11),
        (0.3, 0.03, 0.21, 0.1),
    ],
)
def test_best_heights_are_those_of_the_thesis(
    scene: Scene, shipped: HeightMap, fraction: float, amplitude: float, height: float, remaining: float
) -> None:
    """Brute force by an independent reference; thesis Figs 3.23 and 4.6."""
    best = best_height(DamperResponse(scene.with_(mass_fraction=fraction), 1e-5), amplitude)
    assert best.height == pytest.approx(height, rel=0.03)
    assert 1.0 - best.efficiency == pytest.approx(remaining, abs=0.006)
    assert best.reproducible
    shipped.check(scene)
    entry = shipped.lookup(amplitude, fraction)
    assert entry.height == pytest.approx(height, rel=0.03)
    assert 1.0 - entry.efficiency < remaining + 0.02


def test_the_shipped_map_is_what_the_command_computes_now(scene: Scene, shipped: HeightMap) -> None:
    assert shipped.heights.shape == (3, 101)
    assert list(shipped.mass_fractions) == [0.1, 0.2, 0.3]
    for row, column in ((0, 16), (0, 36), (1, 60), (2, 60)):
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

    def __init__(self, scene: Scene, rtol: float) -> None:
        super().__init__(scene, rtol)
        self.given = scene

    def sufficient(self, amplitude: float, error: float) -> DamperResponse:
        del amplitude, error
        return DamperResponse(self.given, fidelity="impact")


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
    best, complete = best_height(Coarse(soft, 1e-5), 0.01), best_height(Complete(soft, 1e-5), 0.01)
    assert (best.searched, best.checked) == ("impact", "soft")
    assert best.disagreement > FLAT
    assert best.amplitude <= (1.0 + 0.02) * complete.amplitude


def test_a_run_that_settles_or_is_above_its_limit_ends_early(scene: Scene) -> None:
    damper, timing = DamperResponse(scene, 1e-6), Timing(120.0, 16.0)
    whole = damper.opened(0.01, 0.15, timing)
    state = damper.closed_state(0.01)
    early = damper.follow_on(0.01, state, ((0.0, 0.15),), timing, EarlyEnd(1e-3))
    assert early.amplitude == pytest.approx(whole.amplitude, rel=1e-3)
    assert early.regular
    assert state.time < 100.0 * damper.period
    state = damper.closed_state(0.01)
    response = damper.follow_on(0.01, state, ((0.0, 0.08),), timing, EarlyEnd(limit=0.05))
    assert response.exceeded
    assert response.amplitude > 0.05
    assert state.time < 40.0 * damper.period


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
        ({"beam": {"mass": 0.3258, "stiffness": 117.6, "damping": 0.56}}, "beam.stiffness 427.6 117.6"),
        ({"grain": {"mass_fraction": 0.1, "radius": 0.005}}, "grain.radius 0.0085 0.005"),
        ({"contact": {"law": "impact", "restitution": 0.15}}, "contact.law tsuji impact"),
        ({"gravity": 0.0}, "gravity 9.81 0"),
        ({"frequency": 5.0}, "excitation.frequency resonance 5"),
        ({"mass_fraction": 0.05}, "mass fraction 0.05 0.1 0.3"),
    ],
)
def test_another_system_s_map_is_refused(scene: Scene, shipped: HeightMap, change: dict[str, Any], named: str) -> None:
    shipped.check(scene.with_(frequency=scene.natural_frequency_hz))  # the resonance as a number is the resonance
    with refused(MapError, *named.split()):
        shipped.check(scene.with_(**change))


def test_an_amplitude_out_of_the_map_is_refused_and_its_ends_belong_to_it(shipped: HeightMap) -> None:
    for amplitude in (0.0019, 0.0801, -0.01, float("nan"), float("inf")):
        with refused(MapError, "0.002", "0.08"):
            shipped.lookup(amplitude, 0.1)
    for end in (0.002, 0.08):
        for rounding in (-(2.0**-50), 2.0**-50):
            assert shipped.lookup(end * (1.0 + rounding), 0.1) == shipped.lookup(end, 0.1)


@pytest.mark.parametrize(
    ("name", "change"),
    [*((name, np.fliplr) for name in ("heights", "beam_amplitudes", "efficiencies")), ("efficiencies", np.negative)],
)
def test_another_order_is_refused(name: str, change: Callable[[Any], Any], shipped: HeightMap, tmp_path: Path) -> None:
    replace(shipped, **{name: change(getattr(shipped, name))}).save(tmp_path / "map.npz")
    with refused(MapError, "map.npz", "heights", "efficiencies"):
        HeightMap.load(tmp_path / "map.npz")


def test_a_missing_map_and_one_with_holes_are_refused(shipped: HeightMap, gap: HeightMap, tmp_path: Path) -> None:
    with refused(MapError, "none.npz"):
        HeightMap.load(tmp_path / "none.npz")
    holes = replace(shipped, heights=shipped.heights * np.nan)
    for damaged in (holes, replace(gap, failures=gap.failures[:1])):  # a hole without a reason
        damaged.save(tmp_path / "holes.npz")
        with refused(MapError, "holes.npz", "grid"):
            HeightMap.load(tmp_path / "holes.npz")


def test_the_header_holds_the_map_in_micrometres(shipped: HeightMap) -> None:
    text = header_text(shipped, 0.1)
    found = re.search(r"ATPID_TABLE_N (\d+)", text)
    assert found is not None
    count = int(found[1])
    columns = {name: _numbers(text, name) for name in ("atpid_amplitude_um", "atpid_height_um")}
    assert count == 101 == len(columns["atpid_amplitude_um"]) == len(columns["atpid_height_um"])
    assert [columns["atpid_amplitude_um"][k] for k in (0, -1)] == [2000, 80000]
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
    failures = tuple(Failure(0.1, float(shipped.amplitudes[k]), "too deep") for k in missing)
    return with_hole(shipped, (0, missing), failures)


def with_hole(given: HeightMap, place: Any, failures: tuple[Failure, ...]) -> HeightMap:
    grids = {name: getattr(given, name).copy() for name in ("heights", "beam_amplitudes", "efficiencies")}
    for grid in grids.values():
        grid[place] = np.nan
    return replace(given, **grids, failures=failures)


def test_between_points_of_which_one_is_missing_there_is_no_height(gap: HeightMap, shipped: HeightMap) -> None:
    for amplitude in (0.0395, 0.04004, 0.0408, 0.042):
        with refused(MapError, "computed", "too deep"):
            gap.lookup(amplitude, 0.1)
    with refused(MapError, "computed"):
        gap.lookup(0.0408, 0.15)
    assert gap.lookup(0.0408, 0.2) == shipped.lookup(0.0408, 0.2)  # that row is whole
    assert gap.lookup(0.02, 0.1) == shipped.lookup(0.02, 0.1)
    assert all(gap.covers(*span) for span in ((0.002, 0.039, 0.1), (0.043, 0.08, 0.1), (0.002, 0.08, 0.3)))
    assert not any(gap.covers(*span) for span in ((0.002, 0.08, 0.1), (0.001, 0.02, 0.1)))


def test_the_firmware_s_table_has_a_height_that_is_refused_where_there_is_none(gap: HeightMap) -> None:
    heights = _numbers(header_text(gap, 0.1), "atpid_height_um")
    assert (heights.count(0), len(heights)) == (2, 101)


def test_a_map_of_which_no_point_can_be_computed_is_a_failure(scene: Scene, tmp_path: Path) -> None:
    with refused(NumericalFailure, "none", "2", "pressed"):
        build_map(scene, [0.3, 0.4], [0.1], tmp_path / "map.npz")


RATIOS = [0.5, 0.98, 1.0, 1.3]
AMPLITUDES = [0.012, 0.02]
SCENE = standard_bench(excitation={"amplitude": 0.015, "frequency": "resonance"}, tolerance=1e-4)


def near_resonance(ratio: float, scene: Scene = SCENE) -> Scene:
    return scene.with_(frequency=ratio * scene.natural_frequency_hz)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("maps") / "wide.npz"
    build_map(SCENE, AMPLITUDES, [0.1, 0.2], out, frequency_ratios=RATIOS)
    return out


@pytest.fixture(scope="module")
def wide(made: Path) -> HeightMap:
    return HeightMap.load(made)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> HeightMap:
    return build_map(SCENE, AMPLITUDES, [0.1, 0.2], tmp_path_factory.mktemp("maps") / "one.npz")


def test_a_layer_is_the_map_of_its_frequency(wide: HeightMap, one: HeightMap) -> None:
    assert wide.heights.shape == (4, 2, 2)
    assert np.array_equal(wide.heights[2], one.heights)
    assert header_text(wide, 0.1).splitlines()[-3:] == header_text(one, 0.1).splitlines()[-3:]
    assert wide.lookup(0.015, 0.1, 1.0) == one.lookup(0.015, 0.1)
    assert wide.lookup(0.012, 0.1, 0.98).height < one.lookup(0.012, 0.1).height


def test_where_the_grain_is_not_lifted_the_damper_is_closed(wide: HeightMap) -> None:
    """Closed form: the closed beam's acceleration against gravity; below it all heights leave the same."""
    damper = DamperResponse(near_resonance(0.5))
    lift = 0.015 * (np.pi * SCENE.natural_frequency_hz) ** 2 / 9.81 / 0.75
    assert damper.closed_over_gravity(0.015) == pytest.approx(lift, rel=2e-3)
    assert damper.rests(0.012)
    opened = wide.heights > 0.017 + 1e-9
    assert (wide.efficiencies[opened] >= LEAST_USE).all()
    assert (wide.efficiencies[~opened] == 0.0).all()
    entry = wide.lookup(0.012, 0.1, 0.5)
    assert [entry.height, entry.efficiency] == pytest.approx([0.017, 0.0])
    assert entry.amplitude == pytest.approx(damper.closed_amplitude(0.012))
    assert damper.opened(0.012, 0.1, Timing(24.0, 8.0)).amplitude == pytest.approx(entry.amplitude, rel=2e-3)


def test_between_frequencies_the_height_lies_between_theirs_or_is_the_lower_of_two_wells(wide: HeightMap) -> None:
    low, middle, high = (wide.lookup(0.015, 0.1, ratio) for ratio in (0.98, 0.99, 1.0))
    assert low.height < middle.height < high.height
    assert middle.efficiency == pytest.approx(0.5 * (low.efficiency + high.efficiency))
    assert wide.lookup(0.015, 0.1, 1.2).height == pytest.approx(wide.lookup(0.015, 0.1, 1.3).height)
    assert wide.lookup(0.012, 0.1, 0.8).height == pytest.approx(0.017)  # closed on one side


def test_a_frequency_of_the_map_is_that_one_however_it_is_rounded(wide: HeightMap) -> None:
    """Also beside a frequency whose heights lie in another well, and at both ends."""
    rounding = 2.0**-50
    for ratio in RATIOS:
        for near in (ratio * (1.0 - rounding), ratio * (1.0 + rounding)):
            assert wide.lookup(0.012, 0.1, near) == wide.lookup(0.012, 0.1, ratio)


def test_outside_its_frequencies_it_gives_no_height(wide: HeightMap) -> None:
    for ratio in (0.7, 1.0, 1.2):
        wide.check(near_resonance(ratio))
    for ratio in (0.499, 1.301, float("nan")):
        with refused(MapError, "natural", "0.5", "1.3"):
            wide.lookup(0.015, 0.1, ratio)
    assert wide.covers(0.012, 0.02, 0.1, (0.5, 1.3))
    assert not wide.covers(0.012, 0.02, 0.1, (0.5, 1.4))
    assert not HeightMap.load(SHIPPED).covers(0.012, 0.02, 0.1, (0.9, 1.1))


@pytest.mark.parametrize("over_frequencies", [True, False])
def test_reductions_are_against_the_bare_structure(wide: HeightMap, one: HeightMap, over_frequencies: bool) -> None:
    heights = wide if over_frequencies else one
    for place, value in np.ndenumerate(heights.reductions):
        fraction, amplitude = heights.mass_fractions[place[-2]], heights.amplitudes[place[-1]]
        ratio = RATIOS[place[0]] if over_frequencies else 1.0
        scene = near_resonance(ratio, SCENE.with_(mass_fraction=float(fraction)))
        bare = amplitude_without_damper(scene) * amplitude / 0.015
        assert value == pytest.approx(1.0 - heights.beam_amplitudes[place] / bare, rel=1e-9)


@pytest.mark.parametrize("ratios", [[[1.0]], [1.0, 0.9], [0.0, 1.0], [1.0, np.inf], [0.5, 1.0]])
def test_a_damaged_axis_is_refused(made: Path, tmp_path: Path, ratios: object) -> None:
    with np.load(made) as stored:
        arrays = dict(stored)
    np.savez(tmp_path / "bad.npz", **(arrays | {"frequency_ratios": np.array(ratios)}))
    with refused(MapError, "bad.npz"):
        HeightMap.load(tmp_path / "bad.npz")


def test_a_killed_map_is_resumed_not_recomputed(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, journal = tmp_path / "map.npz", tmp_path / "map.npz.journal"
    amplitudes = [round(0.01 + 0.003 * k, 9) for k in range(11)]

    def stop(done: int, of: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_map(scene, amplitudes, [0.1], out, stop)
    assert not out.exists()
    journal.write_bytes(journal.read_bytes() + b'{"point": [0.1, 0.0')  # as a kill tears the last line
    kept = journal.read_bytes().count(b"\n") - 1
    computed = []
    original = best_height

    def counted(damper: DamperResponse, amplitude: float, hysteresis: float) -> Best:
        computed.append(amplitude)
        return original(damper, amplitude, hysteresis)

    monkeypatch.setattr(build, "best_height", counted)
    seen: list[tuple[int, int]] = []
    made = build_map(scene, amplitudes, [0.1], out, lambda *at: seen.append(at))
    assert 3 <= kept < 11
    assert len(computed) == 11 - kept
    assert (seen[0], seen[-1]) == ((kept, 11), (11, 11))
    assert not journal.exists()
    assert (HeightMap.load(out).heights == made.heights).all()


def test_the_journal_of_another_system_or_run_is_refused(scene: Scene, tmp_path: Path) -> None:
    out, journal = tmp_path / "map.npz", tmp_path / "map.npz.journal"
    journal.write_text(json.dumps({"format": 1, "system": {"beam.mass": 1.0}, "tolerance": 1e-5}) + "\n")
    with refused(JournalError, "map.npz.journal", "another"):
        build_map(scene, [0.01, 0.02], [0.1], out)
    journal.write_text("not a journal\n")
    with refused(JournalError, "map.npz.journal", "no journal"):
        build_map(scene, [0.01, 0.02], [0.1], out)
    journal.unlink()
    with journal.open("a+b") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with refused(JournalError, "map.npz", "another run"):
            build_map(scene, [0.01, 0.02], [0.1], out)


_VALUES = st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-10.0, 10.0, allow_subnormal=False).filter(
    lambda value: value == 0.0 or abs(value) > 1e-6
)


@given(
    st.integers(2, 9).flatmap(
        lambda n: st.tuples(arrays(float, n, elements=st.floats(0.01, 5.0)), arrays(float, (n, 3), elements=_VALUES))
    ),
    st.floats(0.0, 1.0),
)
def test_the_curve_is_scipy_s(points: tuple[np.ndarray, np.ndarray], share: float) -> None:
    x, y = np.cumsum(points[0]), points[1]
    place = x[0] + share * (x[-1] - x[0])
    for at in (place, *x):
        np.testing.assert_allclose(monotone(x, y)(at), PchipInterpolator(x, y)(at), rtol=1e-12, atol=1e-12)
    assert monotone(x, y[:, 0])(place) == pytest.approx(monotone(x, y)(place)[0], rel=1e-12, abs=1e-12)


def damper_of(fraction: float) -> DamperResponse:
    return DamperResponse(standard_bench(grain={"mass_fraction": fraction, "radius": 0.0085}), 1e-5)


# wells a hundredth of the ballistic clearance wide, in which the beam arrives after an irregular motion; best of a scan
# of 201 heights, the worst of 21 ways: three speeds of the ceiling, seven phases
@pytest.mark.parametrize(
    ("amplitude", "fraction", "remaining"),
    [(0.0107, 0.1311, 0.04132), (0.00239, 0.0419, 0.02311), (0.00249, 0.0453, 0.02581)],
)
def test_narrow_wells_are_found(amplitude: float, fraction: float, remaining: float) -> None:
    best = best_height(damper_of(fraction), amplitude, approaches=FROM_CLOSED)
    assert best.amplitude <= 1.02 * remaining


def test_the_height_chosen_holds_in_other_phases_as_well() -> None:
    damper, amplitude = damper_of(0.0485619), 0.00290273
    best = best_height(damper, amplitude, approaches=FROM_CLOSED)
    settled = Timing(4.0 * damper.settling(), 30.0)
    for phase in np.linspace(0.1, 0.9, 5):
        path = later(at_once, float(phase))(damper, best.height, 0.0)
        response = damper.follow_on(amplitude, damper.closed_state(amplitude), path, settled)
        assert response.amplitude == pytest.approx(best.amplitude, rel=0.01)
