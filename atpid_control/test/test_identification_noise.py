# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Error bars in noise with memory, and what no tone describes; tests/of_studies counts how often the bars hold."""

import math

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY, PERIOD, RATE, estimates, noise, times, tone

from atpid_control.identification import Quality
from atpid_control.identification.sine_fit import SineFit, fit_sine
from atpid_sim.system import Array

TAU = 2.0 * math.pi


def fitted(rng: np.random.Generator, memory: float, periods: float = 2.0) -> SineFit:
    """Return the fit in a window with noise of 1 % in which each value keeps `memory` of the last."""
    tau = (np.arange(math.ceil(periods * PERIOD * RATE)) + 1) / RATE - periods * PERIOD
    red = rng.normal(0.0, 0.01 * AMPLITUDE * math.sqrt(1.0 - memory**2), tau.size)
    for i in range(1, red.size):
        red[i] += memory * red[i - 1]
    u = AMPLITUDE * np.sin(TAU * FREQUENCY * tau + rng.uniform(0.0, TAU)) + red
    found = fit_sine(tau, u, TAU * FREQUENCY, 0.0, math.inf)
    assert found is not None
    return found


@pytest.mark.parametrize("periods", [1.0, 2.0])
def test_bars_in_white_noise_are_those_of_white_noise(periods: float) -> None:
    rng = np.random.default_rng(11)
    found = [fitted(rng, 0.0, periods) for _ in range(1000)]
    assert sum(one.widened > 1.0 for one in found) <= 6
    assert all(one.widened >= 1.0 for one in found)


def test_bars_in_noise_with_memory_cover_its_density_at_the_tone() -> None:
    rng, memory = np.random.default_rng(12), 0.9
    found = [fitted(rng, memory) for _ in range(200)]
    assert sum(one.widened > 1.0 for one in found) >= 198
    omega = TAU * FREQUENCY / RATE
    density = (1.0 - memory**2) / abs(1.0 - memory * np.exp(-1j * omega)) ** 2
    expected = 0.01 * AMPLITUDE * math.sqrt(2.0 * density / (2.0 * PERIOD * RATE))
    # the largest that a likely noise gives: 1.5 times on the average
    assert 1.0 < np.median([one.amplitude_std for one in found]) / expected < 2.0


def test_a_misfit_within_the_accuracy_of_sensors_is_not_examined() -> None:
    tau = (np.arange(366) - 365) / RATE
    u = AMPLITUDE * (np.sin(TAU * FREQUENCY * tau) + 3e-5 * np.sin(TAU * 8.0 * tau))
    found = fit_sine(tau, u, TAU * FREQUENCY, 0.0, math.inf)
    assert found is not None
    assert (found.widened, found.foreign) == (1.0, math.inf)


def _cut(t: Array) -> Array:
    return np.clip(tone(t), -0.9 * AMPLITUDE, AMPLITUDE)


def _halved(t: Array) -> Array:
    return tone(t) + tone(t, 0.05 * AMPLITUDE, 0.5 * FREQUENCY, 1.0)


@pytest.mark.parametrize("spoil", [_cut, _halved])
def test_cut_crests_and_a_subharmonic_are_never_steady_and_end_with_their_cause(spoil: object) -> None:
    assert callable(spoil)
    rng, t = np.random.default_rng(13), times(6.0)
    u = np.where((t > 2.0) & (t < 4.0), spoil(t), tone(t)) + noise(rng, t.size, 50.0)
    found = estimates(u)
    inside = [e.quality for e in found if 2.0 + 2.0 * PERIOD < e.time < 4.0]
    assert set(inside) <= {Quality.POOR, Quality.TRANSIENT}
    assert inside.count(Quality.POOR) > 0.8 * len(inside)
    after = [e for e in found if e.time > 4.0 + 2.5 * PERIOD]
    assert {e.quality for e in after} == {Quality.STEADY}
    assert max(abs(e.amplitude / AMPLITUDE - 1.0) for e in after) < 0.005


def test_harmonics_and_steps_are_not_taken_for_cut_crests() -> None:
    rng, t = np.random.default_rng(14), times(6.0)
    for phase in rng.uniform(0.0, TAU, 12):
        rich = tone(t) + tone(t, 0.05 * AMPLITUDE, 2 * FREQUENCY, phase) + tone(t, 0.05 * AMPLITUDE, 3 * FREQUENCY)
        stepped = tone(t, np.where(t < 3.0, 1.0, 1.2) * AMPLITUDE, phase=phase)
        assert {e.quality for e in estimates(rich + noise(rng, t.size, 50.0))[10:]} == {Quality.STEADY}
        assert Quality.POOR not in {e.quality for e in estimates(stepped + noise(rng, t.size, 50.0))}


def test_an_offset_that_wanders_does_not_bend_the_frequency() -> None:
    rng, t = np.random.default_rng(15), times(8.0)
    u = tone(t) + 0.2 * AMPLITUDE * np.sin(TAU * 0.3 * t) + noise(rng, t.size, 40.0)
    late = [e for e in estimates(u)[20:] if e.quality == Quality.STEADY]
    ratios = [(e.frequency - FREQUENCY) / e.frequency_std for e in late]
    assert len(late) > 100
    assert np.sqrt(np.mean(np.square(ratios))) < 1.4
