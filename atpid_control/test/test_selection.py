# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One contract for every selector, what a request may ask for, and the predictive algorithm against the thesis."""

import gc
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands_run import answered, refusal
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.identification import Estimate, Quality
from atpid_control.selection import Excitation, HeightSelector, Selection, SelectionError, make_selector
from atpid_control.selection.by_rms import Realisation, least_rms
from atpid_control.selection.checks import HeightRequest, Resonance, resolved
from atpid_control.selection.direct import without_collection
from atpid_control.selection.pca import PcaSelector, tune
from atpid_control.selection.pca_models import ComplexModel, Impact, judge, response_lag, simplified
from atpid_control.selection.protocol import violations
from atpid_control.selection.registry import METHODS
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse, best_height, build_map
from atpid_sim.scene import Scene, load_scene, scene_from_mapping, standard_bench
from atpid_sim.scene.ceiling import CONTROLLERS
from atpid_sim.simulation.simulate import simulate
from atpid_sim.simulation.unrepeated import vibration

ROOT = Path(__file__).parents[2]
MAP = ROOT / "atpid_control" / "config" / "maps" / "standard.npz"
SCENE, STANDARD = (load_scene(ROOT / "scenes" / f"{name}.yaml") for name in ("thesis_4_3", "standard"))
SELECTING = ("lookup", "pca", "direct", "search")


class Careless:
    """A selector that keeps to nothing."""

    method, simulates = "", 1

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        return Selection(-0.1 + margin, -1.0, 2.0, "other")


@pytest.fixture(scope="module")
def selectors() -> dict[str, HeightSelector]:
    return {method: make_selector(method, SCENE, MAP if method == "lookup" else None) for method in SELECTING}


def test_the_methods_are_those_of_the_registry_and_of_scenes() -> None:
    assert set(METHODS) == {*SELECTING, "fixed"} == {*CONTROLLERS, "fixed"}
    with pytest.raises(SelectionError, match=rf"'guess'; .*{'.*'.join(METHODS)}$"):
        make_selector("guess", SCENE)
    careless: Any = Careless()
    assert len(violations(careless, 0.03, 0.017)) == 6  # each is named


@pytest.mark.parametrize("method", SELECTING)
def test_methods_keep_the_contract_at_the_thesis_heights(selectors: dict[str, HeightSelector], method: str) -> None:
    selector = selectors[method]
    assert violations(selector, 0.03, 2.0 * SCENE.grain.radius) == []
    for amplitude, height in ((0.015, 0.29), (0.04, 0.76), (0.03, 0.57)):
        chosen = selector.select(Excitation(amplitude))
        assert chosen.method == selector.method == method
        assert chosen.height == pytest.approx(height, rel=0.06)
        assert 1.0 - chosen.efficiency < 0.21
        assert chosen.price == 0.0
    if method != "search":  # it watches the damper itself; there is nothing to be safe from
        assert selector.select(Excitation(0.03, 0.001), margin=2.0).height < chosen.height
    for margin in (-1.0, math.nan, math.inf):
        with pytest.raises(SelectionError, match=f"^margin: given {margin:g}"):
            selector.select(Excitation(0.03), margin)
    if method in ("pca", "direct"):
        again = selector.select(Excitation(0.03))
        assert (again.height, again.beam_amplitude) == (chosen.height, chosen.beam_amplitude)


@pytest.mark.parametrize("name", ["amplitude", "amplitude_std", "frequency"])
def test_an_impossible_excitation_is_refused(name: str) -> None:
    for value in (math.inf, -0.01, math.nan if name != "frequency" else 0.0, 0.0 if name == "amplitude" else -5.0):
        with pytest.raises(SelectionError, match=rf"^{name}: given {value:g}\b[^\n]*$"):
            Excitation(**({"amplitude": 0.03} | {name: value}))


def test_the_collection_is_postponed_and_comes_back_after_an_error() -> None:
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError), without_collection():
        _ = 1 / gc.isenabled()  # disabled: division by zero
    assert gc.isenabled()
    gc.disable()
    try:
        with without_collection():
            pass
        assert not gc.isenabled()  # what the caller had chosen
    finally:
        gc.enable()


# requests

RESONANCE = Resonance(5.47, 0.03)
LATEST = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.5)


@pytest.mark.parametrize(
    ("name", "values", "allowed"),
    [
        ("amplitude", (-1.0, math.nan, math.inf), r"\b0\b"),
        ("amplitude_std", (-1.0, math.nan), r"\b0\b"),
        ("margin", (-3.0, 1e9, math.nan), r"\b0 to 100\b"),
        ("frequency", (9.0, -5.47, math.nan), r"\b5\.47 Hz .*3 %"),
    ],
)
def test_nonsense_is_refused(name: str, values: tuple[float, ...], allowed: str) -> None:
    for value in values:
        given = re.escape(f"{name}: given {value:g}")
        with pytest.raises(SelectionError, match=rf"^{given}\b[^\n]*; allowed: [^\n]*{allowed}[^\n]*$"):
            resolved(HeightRequest(**({"amplitude": 0.03} | {name: value})), LATEST, RESONANCE)


def test_zero_stands_for_the_latest_estimate_and_the_resonance() -> None:
    assert resolved(HeightRequest(0.0, margin=3.0), LATEST, RESONANCE) == HeightRequest(0.03, 1e-5, 5.5, 3.0)
    assert resolved(HeightRequest(0.02), LATEST, RESONANCE) == HeightRequest(0.02, 0.0, 5.47, 0.0)
    with pytest.raises(SelectionError, match="estimate"):
        resolved(HeightRequest(0.0), None, RESONANCE)
    with pytest.raises(SelectionError, match=r"^frequency: .*\b6\.5 Hz"):  # off resonance, as in the loop
        resolved(HeightRequest(0.0), replace(LATEST, frequency=6.5), RESONANCE)
    # a method for any frequency is asked from half to twice the natural one
    wide = replace(RESONANCE, reach=(2.735, 10.94))
    assert resolved(HeightRequest(0.02, frequency=9.0), LATEST, wide).frequency == 9.0
    assert resolved(HeightRequest(0.02), LATEST, wide).frequency == 5.47
    with pytest.raises(SelectionError, match=r"^frequency: .*\b11 Hz; .*\b2\.735 to 10\.94 Hz, .* 5\.47 Hz"):
        resolved(HeightRequest(0.02, frequency=11.0), LATEST, wide)


@given(*[st.floats()] * 4)
def test_what_is_taken_can_be_computed(amplitude: float, amplitude_std: float, frequency: float, margin: float) -> None:
    try:
        asked = resolved(HeightRequest(amplitude, amplitude_std, frequency, margin), LATEST, RESONANCE)
    except SelectionError:
        return
    assert 0.0 < asked.amplitude < math.inf
    assert 0.0 <= asked.amplitude_std < math.inf
    assert 0.0 <= asked.margin <= 100.0
    assert asked.frequency == pytest.approx(5.47, rel=0.0301)


# the predictive algorithm, section 4.4 of the thesis


@pytest.mark.parametrize(("amplitude", "height"), [(0.07, 1.98), (0.05, 1.41), (0.02, 0.55)])
def test_the_first_guess_is_the_thesis_s(amplitude: float, height: float) -> None:
    model = simplified(system_of(STANDARD), STANDARD.frequency_hz, amplitude)
    assert model.first_height() == pytest.approx(height, abs=0.005)


def test_the_first_impact_and_the_second_guess_are_the_thesis_s() -> None:
    model = simplified(system_of(STANDARD), STANDARD.frequency_hz, 0.07)
    assert model.top_speed == pytest.approx(21.96, abs=0.005)
    # printed after Fig. 4.25: X_beam = -0.0402 m, V_beam = 21.92 m/s, V_grain = -22.79 m/s
    _, impact = model.first_return(model.first_height())
    assert impact.beam == pytest.approx(-0.0402, abs=0.0015)
    assert impact.beam_velocity == pytest.approx(21.92, abs=0.02)
    assert impact.grain_velocity == pytest.approx(-22.79, abs=0.06)
    # after Fig. 4.30: X_beam = 0.097 m, V_grain = 12.83 m/s; by hand t_c1 = asin(0.097/0.639)/omega
    flight = (math.pi - math.asin(0.097 / model.amplitude)) / model.omega
    by_hand = 0.017 + 0.097 + 12.83 * flight - 0.5 * 9.81 * flight**2
    assert model.next_height(Impact(0.097, 8.38, 12.83)) == pytest.approx(by_hand, rel=1e-12)
    # the bare beam lags by less than a quarter of a period
    assert 0.0 < response_lag(system_of(STANDARD), STANDARD.frequency_hz) < 0.5 * math.pi


@given(amplitude=st.floats(1e-4, 1.0), floor=st.floats(-5.0, 5.0), rate=st.floats(-50.0, 50.0))
def test_the_next_guess_is_finite_wherever_the_beam_is(amplitude: float, floor: float, rate: float) -> None:
    model = simplified(system_of(STANDARD), 5.49, amplitude)
    assert math.isfinite(model.next_height(Impact(floor, 0.0, rate)))


def test_every_iteration_is_visible_and_there_are_at_most_twenty() -> None:
    selector = PcaSelector(STANDARD)
    chosen = {amplitude: selector.select(Excitation(amplitude)) for amplitude in (0.01, 0.02, 0.03, 0.05, 0.07, 0.08)}
    assert max(one.evaluations for one in chosen.values()) <= 20
    stages = chosen[0.05].stages
    names = [stage.name for stage in stages]
    assert names[:4] == ["SM", "SM + PM1", "CM1", "PM2 + CM2"]
    assert {"PCA", "tuning 1"} <= set(names)
    assert (names[-1], stages[-1].height) == ("result", chosen[0.05].height)


@pytest.mark.parametrize("fraction", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("amplitude", [0.02, 0.05, 0.08])
def test_tuned_it_is_close_to_the_best(fraction: float, amplitude: float) -> None:
    heavy = STANDARD.with_(mass_fraction=fraction)
    best = best_height(DamperResponse(heavy, 1e-5), amplitude)
    assert PcaSelector(heavy).select(Excitation(amplitude)).efficiency > best.efficiency - 0.02


def test_tuning_follows_the_printed_steps_within_its_limits() -> None:
    visited: list[float] = []

    def probe(height: float) -> float:
        visited.append(height)
        return 1.0 + (height - 0.85) ** 2 * 40.0

    height, amplitude = tune(probe, 1.0, 1.0 + 0.15**2 * 40.0, 0.1, 10.0)
    assert visited[:4] == pytest.approx([0.9, 0.81, 0.729, 0.729 * (1.0 + 0.1 / 1.5)])
    assert height == pytest.approx(0.85, rel=0.02)
    assert amplitude < 1.01
    assert tune(lambda h: h, 1.0, 1.0, 0.5, 2.0)[0] == 0.5


def test_the_criteria_know_the_optimal_motion() -> None:
    period, times = 1.0, np.linspace(0.0, 10.0, 1281)
    rates = np.cos(2.0 * np.pi * times)
    impacts = np.array([[k + at, wall, 3.0] for k in range(10) for at, wall in ((0.02, 1.0), (0.52, -1.0))])

    def broken(seen: np.ndarray, longest: float = 0.01) -> tuple[str, ...]:
        return judge(seen, times, rates, longest, period).broken

    assert broken(impacts) == ()
    assert broken(impacts, 0.06) == ("4.5",)
    assert "4.3" in broken(impacts[:-6])
    assert "4.4" in broken(impacts + np.array([0.2, 0.0, 0.0]))
    assert "4.1" in broken(impacts * [1.0, 1.0, 0.1])
    assert broken(impacts[:0]) == ("4.1", "4.2", "4.3", "4.4")


SECOND = {"mass": 2.4, "frequency": 56.0, "damping_ratio": 0.02, "drive_factor": -0.18}
AMPLITUDE = {"support": 0.01, "force": 4.0}


def two_modes(drive: str = "support", **changes: Any) -> Scene:
    tone = {"amplitude": AMPLITUDE[drive], "frequency": "resonance"}
    return standard_bench(**({"further_modes": [SECOND], "drive": drive, "excitation": tone} | changes))


@pytest.mark.parametrize("drive", AMPLITUDE)
@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.04, 1.15])
def test_the_simplified_model_is_the_lesser_of_free_and_closed_modes(drive: str, ratio: float) -> None:
    scene = two_modes(drive)
    frequency = ratio * scene.natural_frequency_hz
    model = simplified(system_of(scene), frequency, 0.01)
    both = [scene.linear_amplitude(0.01, frequency, grain=grain) for grain in (False, True)]
    assert model.amplitude == pytest.approx(min(both), rel=1e-12)


def test_the_complex_model_begins_where_the_simplified_one_is() -> None:
    """Without a ceiling to meet and a grain of no weight the structure goes on as it was, from the first period."""
    scene = two_modes("force", gravity=0.0, grain={"mass_fraction": 1e-6, "radius": 0.0085})
    damper = DamperResponse(scene, 1e-8)
    sm = simplified(damper.system, damper.frequency, 4.0)
    model = ComplexModel(damper, 4.0, *sm.first_return(0.3), 1e3)
    assert model.observe(1e3, 0.0, 4.0)[0] == pytest.approx(sm.amplitude, rel=1e-3)


@pytest.mark.parametrize("drive", AMPLITUDE)
def test_pca_is_close_to_the_best(drive: str) -> None:
    scene = two_modes(drive)
    chosen = make_selector("pca", scene).select(Excitation(AMPLITUDE[drive]))
    assert [stage.name for stage in chosen.stages][:3] == ["SM", "SM + PM1", "CM1"]
    assert chosen.beam_amplitude < 1.05 * best_height(DamperResponse(scene, 1e-5), AMPLITUDE[drive]).amplitude


def test_a_force_is_refused_in_newtons(tmp_path: Path) -> None:
    scene = two_modes("force")
    made = build_map(scene, [3.0, 4.0], [scene.grain.mass_fraction], tmp_path / "force.npz")
    assert np.isnan(made.reductions).all()  # of one mode on its support, which is not this structure
    lookup = make_selector("lookup", scene, tmp_path / "force.npz")
    assert lookup.select(Excitation(4.0)).efficiency > 0.7
    with pytest.raises(SelectionError, match=r"\b5 N .*\b3 to 4 N"):
        lookup.select(Excitation(5.0))


# by root mean square


def noisy(duration: float = 12.0, **changes: Any) -> Scene:
    """Heights of one realisation are compared, which a window of some forty periods does as well as a long one."""
    psd = {"psd": [[2.0, 1.0e-5], [12.0, 1.0e-5]], "unit": "m^2/Hz"}
    scene = {"excitation": {"random": psd}, "tolerance": 1e-4, "seed": 3, "steady_window": [5.0, duration]}
    return standard_bench(**(scene | changes), duration=duration)


def test_a_height_is_rated_as_a_run_is() -> None:
    """Every height under the same drive, that of `simulate`."""
    scene = noisy()
    own = Realisation(scene)
    for height in (0.06, 0.12):
        run = simulate(scene.with_(height=height), check=False)
        assert own.rated(height).rms == pytest.approx(run.rms, rel=1e-12)
        assert math.sqrt(float(np.mean(own.closed))) == pytest.approx(run.undamped_rms, rel=1e-12)
    low, high = (vibration(scene.with_(height=height)).support for height in (0.06, 0.12))
    assert np.array_equal(low, high)


def test_the_height_of_least_rms_is_that_of_a_scan() -> None:
    force = {"random": {"psd": [[2.0, 1.5], [12.0, 1.5]], "unit": "m^2/Hz"}}
    scene = noisy(drive="force", further_modes=[SECOND], excitation=force)
    chosen, bare, _ = least_rms(scene)
    own = Realisation(scene)
    scanned = [own.rated(float(height)).rms for height in np.linspace(0.02, 2.0 * chosen.height, 20)]
    assert chosen.beam_amplitude <= 1.01 * min(scanned)
    assert chosen.efficiency > 0.2
    assert chosen.beam_amplitude < bare
    assert [stage.name.split()[0] for stage in chosen.stages] == ["RMS", "as", "again"]
    assert re.match(r"seed 4,.* 0\.\d+ ± ", chosen.stages[2].note)


def test_heights_keep_to_the_range_and_where_the_grain_is_not_lifted_the_damper_stays_closed() -> None:
    ceiling = {"closed": 0.05, "range": [0.05, 0.08], "speed": 0.3, "controller": "direct"}
    assert 0.05 <= least_rms(noisy(8.0, ceiling=ceiling))[0].height <= 0.08
    quiet = {"tones": [{"amplitude": 1e-4, "frequency": 5.3}, {"amplitude": 1e-4, "frequency": 5.9}]}
    chosen, _, _ = least_rms(noisy(8.0, excitation=quiet))
    assert (chosen.height, chosen.efficiency) == (0.017, 0.0)
    assert re.search(r"0\.\d{4} m, .*-?\d+\.\d % .* closed$", chosen.no_use)


def test_the_command_selects_by_rms_and_refuses_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tones = {"tones": [{"amplitude": 0.004, "frequency": 5.3}, {"amplitude": 0.003, "frequency": 5.9}]}
    scene = scene_from_mapping(noisy(excitation=tones).to_mapping())
    file = tmp_path / "tones.yaml"
    file.write_text(scene.to_yaml())
    found = answered(capsys, "select", file, "--method", "direct")
    assert found["measure"].split() == ["root", "mean", "square"]
    assert found["amplitude"] == pytest.approx(simulate(scene.with_(height=found["height"]), check=False).rms, rel=1e-9)
    assert len(found["stages"]) == 2  # tones are the same again
    for words in (["--method", "pca"], ["--method", "direct", "--margin", "2"]):
        assert re.match(rf"error: excitation: .*tones.* {words[1]}", refusal(capsys, "select", file, *words))
