# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A frequency that drifts is followed as a steady tone's; a step is still a step."""

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY, RATE, SETTINGS, estimates, noise, times, with_

from atpid_control.identification import Estimate, Quality
from atpid_sim.system import Array

DRIFTING = with_(slow_drift=0.03)


def chirp(t: Array, rate: float, begin: float = 1.0) -> tuple[Array, Array]:
    """Return a tone (n,) [m] that drifts by `rate` [1/s] from `begin` [s] on, and its frequency [Hz]."""
    frequency = FREQUENCY * (1.0 + rate * np.clip(t - begin, 0.0, None))
    return AMPLITUDE * np.sin(2.0 * np.pi * np.cumsum(frequency) / RATE), frequency


def followed(rate: float, decibels: float) -> tuple[list[Estimate], Array]:
    """Return the estimates after the second second, and the true frequency at each of them [Hz]."""
    t = times(10.0)
    signal, frequency = chirp(t, rate)
    found = estimates(signal + noise(np.random.default_rng(3), t.size, decibels), DRIFTING)
    assert sum(one.changed for one in found if one.quality == Quality.STEADY) == 1  # the first: from nothing
    late = [one for one in found if one.time > 2.0]
    return late, np.array([frequency[one.last_index] for one in late])


@pytest.mark.parametrize("rate", [0.01, -0.01])
@pytest.mark.parametrize("decibels", [20.0, 40.0, 60.0, 100.0])
def test_one_per_cent_a_second_is_followed_at_any_noise_without_a_step(rate: float, decibels: float) -> None:
    late, frequency = followed(rate, decibels)
    assert all(one.quality == Quality.STEADY for one in late)
    error = np.array([one.frequency for one in late]) / frequency - 1.0
    # where noise hides the drift inside a window, the estimate is that of its middle, 0.18 s ago
    assert abs(error.mean()) < (0.003 if decibels <= 40.0 else 2e-5)
    assert np.abs(np.array([one.amplitude for one in late]) / AMPLITUDE - 1.0).max() < 10.0 ** (-decibels / 20.0) + 1e-3


def test_error_bars_hold_for_a_drifting_frequency_and_its_phase() -> None:
    late, frequency = followed(0.01, 60.0)
    assert np.mean([one.drift for one in late]) == pytest.approx(0.0095, abs=0.0005)  # 0.01 at its start, a tenth less
    off = (np.array([one.frequency for one in late]) - frequency) / np.array([one.frequency_std for one in late])
    assert 0.6 < off.std() < 1.4
    signal = np.array([one.amplitude * np.sin(one.phase) for one in late])
    true, _ = chirp(times(10.0), 0.01)
    spread = np.array([np.hypot(one.amplitude_std, AMPLITUDE * one.phase_std) for one in late])
    assert (np.abs(signal - true[[one.last_index for one in late]]) < 5.0 * spread).all()


def test_a_faster_change_and_one_of_the_amplitude_stay_transient() -> None:
    t = times(6.0)
    fast, _ = chirp(t, 0.1)
    growing = AMPLITUDE * (1.0 + 0.2 * t) * np.sin(2.0 * np.pi * FREQUENCY * t)
    for signal in (fast, growing):
        late = [one for one in estimates(signal, DRIFTING) if one.time > 2.0]
        assert all(one.quality == Quality.TRANSIENT for one in late)


@pytest.mark.parametrize("step", [0.02, -0.05, 0.3])
def test_a_step_of_the_frequency_is_one_change(step: float) -> None:
    t = times(6.0)
    frequency = np.where(t < 3.0, FREQUENCY, FREQUENCY * (1.0 + step))
    signal = AMPLITUDE * np.sin(2.0 * np.pi * np.cumsum(frequency) / RATE)
    found = estimates(signal + noise(np.random.default_rng(5), t.size, 60.0), DRIFTING)
    ends = [one for one in found if one.changed and one.quality == Quality.STEADY]
    assert len(ends) == 2
    assert 3.0 < ends[1].time < 3.6
    assert found[-1].frequency == pytest.approx(frequency[-1], rel=1e-3)


def test_without_the_setting_a_drift_is_transient_as_before() -> None:
    signal, _ = chirp(times(6.0), 0.01)
    late = [one for one in estimates(signal, SETTINGS) if one.time > 2.0]
    assert all(one.quality == Quality.TRANSIENT for one in late)
