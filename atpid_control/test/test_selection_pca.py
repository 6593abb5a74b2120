# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The predictive control algorithm against the thesis's own numbers (section 4.4)."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.selection.complex_model import judge
from atpid_control.selection.pca import PcaSelector, tune
from atpid_control.selection.predictive import Impact, response_lag, simplified
from atpid_control.selection.protocol import Excitation
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse, best_height
from atpid_sim.scene import Scene, load_scene

SCENE = Path(__file__).parents[2] / "scenes" / "standard.yaml"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SCENE)


@pytest.mark.parametrize(("amplitude", "height"), [(0.07, 1.98), (0.05, 1.41), (0.02, 0.55)])
def test_the_first_guess_is_the_thesis_s(scene: Scene, amplitude: float, height: float) -> None:
    model = simplified(system_of(scene), scene.frequency_hz, amplitude)
    assert model.first_height() == pytest.approx(height, abs=0.005)


def test_the_first_impact_is_the_thesis_s(scene: Scene) -> None:
    model = simplified(system_of(scene), scene.frequency_hz, 0.07)
    assert model.top_speed == pytest.approx(21.96, abs=0.005)
    # printed after Fig. 4.25: X_beam = -0.0402 m, V_beam = 21.92 m/s, V_grain = -22.79 m/s
    _, impact = model.first_return(model.first_height())
    assert impact.beam == pytest.approx(-0.0402, abs=0.0015)
    assert impact.beam_velocity == pytest.approx(21.92, abs=0.02)
    assert impact.grain_velocity == pytest.approx(-22.79, abs=0.06)


def test_the_second_guess_uses_the_printed_impact(scene: Scene) -> None:
    # after Fig. 4.30: X_beam = 0.097 m, V_grain = 12.83 m/s; by hand t_c1 = asin(0.097/0.639)/omega
    model = simplified(system_of(scene), scene.frequency_hz, 0.07)
    flight = (math.pi - math.asin(0.097 / model.amplitude)) / model.omega
    by_hand = 0.017 + 0.097 + 12.83 * flight - 0.5 * 9.81 * flight**2
    assert model.next_height(Impact(0.097, 8.38, 12.83)) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.slow
@given(amplitude=st.floats(1e-4, 1.0), floor=st.floats(-5.0, 5.0), rate=st.floats(-50.0, 50.0))
def test_the_next_guess_is_finite_wherever_the_beam_is(amplitude: float, floor: float, rate: float) -> None:
    model = simplified(system_of(load_scene(SCENE)), 5.49, amplitude)
    assert math.isfinite(model.next_height(Impact(floor, 0.0, rate)))


def test_the_bare_beam_lags_by_less_than_a_quarter_of_a_period(scene: Scene) -> None:
    assert 0.0 < response_lag(system_of(scene), scene.frequency_hz) < 0.5 * math.pi


def test_every_iteration_is_visible(scene: Scene) -> None:
    chosen = PcaSelector(scene).select(Excitation(0.05))
    names = [stage.name for stage in chosen.stages]
    assert names[:4] == ["SM", "SM + PM1", "CM1", "PM2 + CM2"]
    assert "PCA" in names
    assert "tuning 1" in names
    assert names[-1] == "result"
    assert chosen.stages[-1].height == chosen.height
    assert any(stage.note == "all criteria hold" for stage in chosen.stages)


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("amplitude", [0.02, 0.05, 0.08])
def test_tuned_it_is_close_to_the_best(scene: Scene, fraction: float, amplitude: float) -> None:
    heavy = scene.with_(mass_fraction=fraction)
    chosen = PcaSelector(heavy).select(Excitation(amplitude))
    best = best_height(DamperResponse(heavy, 1e-5), amplitude)
    assert chosen.efficiency > best.efficiency - 0.02


def test_without_gravity_it_is_right_at_every_amplitude(scene: Scene) -> None:
    # Fig. 4.43: without gravity the error does not depend on the amplitude
    selector = PcaSelector(scene, gravity=False)
    damper = DamperResponse(scene.with_(gravity=0.0), 1e-5)
    for amplitude in (0.002, 0.01, 0.05):
        assert selector.select(Excitation(amplitude)).efficiency > best_height(damper, amplitude).efficiency - 0.01


def test_with_tuning_it_takes_at_most_twenty_evaluations(scene: Scene) -> None:
    selector = PcaSelector(scene)
    assert (
        max(selector.select(Excitation(amplitude)).evaluations for amplitude in (0.01, 0.02, 0.03, 0.05, 0.07, 0.08))
        <= 20
    )


def test_tuning_follows_the_printed_steps() -> None:
    visited: list[float] = []

    def probe(height: float) -> float:
        visited.append(height)
        return 1.0 + (height - 0.85) ** 2 * 40.0

    height, amplitude = tune(probe, 1.0, 1.0 + 0.15**2 * 40.0, 0.1, 10.0)
    assert visited[:2] == pytest.approx([0.9, 0.81])
    assert visited[2] == pytest.approx(0.729)
    assert visited[3] == pytest.approx(0.729 * (1.0 + 0.1 / 1.5))
    assert height == pytest.approx(0.85, rel=0.02)
    assert amplitude < 1.01


def test_tuning_stays_within_its_limits() -> None:
    height, _ = tune(lambda h: h, 1.0, 1.0, 0.5, 2.0)
    assert height == 0.5


def test_the_criteria_know_the_optimal_motion() -> None:
    period, times = 1.0, np.linspace(0.0, 10.0, 1281)
    rates = np.cos(2.0 * np.pi * times)
    floor = np.array([[k + 0.02, 1.0, 3.0] for k in range(10)])
    ceiling = np.array([[k + 0.52, -1.0, 3.0] for k in range(10)])
    impacts = np.concatenate([floor, ceiling])
    impacts = impacts[np.argsort(impacts[:, 0])]
    assert not judge(impacts, times, rates, 0.01, period).broken
    assert judge(impacts, times, rates, 0.06, period).broken == ("4.5",)
    assert "4.3" in judge(impacts[:-6], times, rates, 0.01, period).broken
    assert "4.4" in judge(impacts + np.array([0.2, 0.0, 0.0]), times, rates, 0.01, period).broken
    assert "4.1" in judge(impacts * [1.0, 1.0, 0.1], times, rates, 0.01, period).broken
    assert judge(impacts[:0], times, rates, 0.01, period).broken == ("4.1", "4.2", "4.3", "4.4")
