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
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.identification import Estimate, Quality
from atpid_control.selection import METHODS, Excitation, HeightSelector, Selection, SelectionError, make_selector
from atpid_control.selection.checks import HeightRequest, Resonance, resolved
from atpid_control.selection.complex_model import judge
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.pca import PcaSelector, tune
from atpid_control.selection.predictive import Impact, response_lag, simplified
from atpid_control.selection.protocol import violations
from atpid_control.selection.workers import without_collection
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse, best_height
from atpid_sim.scene import load_scene, standard_bench
from atpid_sim.scene.ceiling import CONTROLLERS

ROOT = Path(__file__).parents[2]
MAP = ROOT / "atpid_control" / "config" / "maps" / "standard.npz"
SCENE, STANDARD = (load_scene(ROOT / "scenes" / f"{name}.yaml") for name in ("thesis_4_3", "standard"))
SELECTING = ("lookup", "learned", "pca", "direct", "search")


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
def test_every_method_keeps_the_contract_at_the_thesis_heights(
    selectors: dict[str, HeightSelector], method: str
) -> None:
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


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("amplitude", (math.nan, math.inf, 0.0, -0.01)),
        ("amplitude_std", (math.nan, math.inf, -1.0)),
        ("frequency", (math.inf, 0.0, -5.0)),
    ],
)
def test_an_impossible_excitation_is_refused(name: str, values: tuple[float, ...]) -> None:
    for value in values:
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


def test_a_selection_collects_no_garbage() -> None:
    selector, begun = DirectSelector(standard_bench()), list[str]()

    def note(phase: str, _: dict[str, int]) -> None:
        begun.append(phase)

    gc.callbacks.append(note)
    try:
        gc.set_threshold(1)
        selector.select(Excitation(0.01))
        during = begun.count("start")
    finally:
        gc.set_threshold(700, 10, 10)
        gc.callbacks.remove(note)
    assert during < 100  # before and after the search; within it there are thousands


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
def test_what_is_accepted_can_be_computed(
    amplitude: float, amplitude_std: float, frequency: float, margin: float
) -> None:
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
    assert any(re.match(r"all\b", stage.note) for stage in stages)


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
