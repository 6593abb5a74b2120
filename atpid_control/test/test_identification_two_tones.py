# SPDX-License-Identifier: Apache-2.0
"""Two tones are refused with a sentence; whatever a single tone does is not taken for two."""

from itertools import product

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY, RATE, noise, times, tone, with_

from atpid_control.identification import Estimate, Identifier, Quality
from atpid_control.identification.two_tones import TwoTones
from atpid_sim.system import Array

SETTINGS = with_(second_tone=0.1, slow_drift=0.03)


def pushed(
    signal: Array, decibels: float = 57.0, identifier: Identifier | None = None
) -> list[tuple[Estimate, TwoTones | None]]:
    """Return each estimate of a signal with noise, and the two tones at that moment."""
    identifier, found = identifier or Identifier(SETTINGS), []
    noisy = signal + noise(np.random.default_rng(2), signal.size, decibels)
    for first in range(0, signal.size, 50):
        part = noisy[first : first + 50]
        estimate = identifier.push(first, RATE, part, None, (first + part.size - 1) / RATE)
        found.append((estimate, identifier.two_tones))
    return found


def second(t: Array, frequency: float, share: float) -> Array:
    return share * AMPLITUDE * np.sin(2.0 * np.pi * frequency * t + 1.0)


@pytest.mark.parametrize("decibels", [20.0, 57.0])
@pytest.mark.parametrize(("frequency", "share"), [(2.2, 0.2), *product([3.9, 6.4, 7.1, 9.0], [0.2, 1.0])])
def test_two_tones_are_named_within_three_seconds(frequency: float, share: float, decibels: float) -> None:
    t = times(6.0)
    late = [pair for pair in pushed(tone(t) + second(t, frequency, share), decibels) if pair[0].time > 3.0]
    assert all(estimate.quality == Quality.POOR for estimate, _ in late)
    found = late[-1][1]
    assert found is not None
    assert sorted(found.frequencies) == pytest.approx(sorted([FREQUENCY, frequency]), rel=5e-3)
    assert sorted(found.amplitudes) == pytest.approx(sorted([AMPLITUDE, share * AMPLITUDE]), rel=0.05)
    assert "two tones excite the structure" in found.sentence("m")
    assert "\n" not in found.sentence("m")


def single() -> dict[str, Array]:
    """Return signals of one tone, whatever it does."""
    t = times(8.0)

    def phase(frequency: Array) -> Array:
        return AMPLITUDE * np.sin(2.0 * np.pi * np.cumsum(frequency) / RATE)

    steady = np.full(t.size, FREQUENCY)
    return {
        "steady": tone(t),
        "ramp": tone(t, AMPLITUDE * (1.0 + 0.5 * np.clip(t - 3.0, 0.0, 2.0))),
        "step up": tone(t, np.where(t > 4.0, 2.0 * AMPLITUDE, AMPLITUDE)),
        "step down": tone(t, np.where(t > 4.0, 0.3 * AMPLITUDE, AMPLITUDE)),
        "frequency steps": phase(np.where(t < 4.0, steady, 1.3 * steady)),
        "frequency drifts": phase(steady * (1.0 + 0.01 * t)),
        "frequency sweeps": phase(steady * (1.0 + 0.2 * np.clip(t - 2.0, 0.0, None))),
        "harmonic": tone(t) + second(t, 2.0 * FREQUENCY, 0.3),
        "hum": tone(t) + second(t, 50.0, 0.3),
        "beat": tone(t) + second(t, FREQUENCY + 0.3, 0.4),
        "weak": tone(t) + second(t, 7.1, 0.05),
    }


@pytest.mark.parametrize("name", single())
@pytest.mark.parametrize("decibels", [20.0, 60.0])
def test_one_tone_is_never_taken_for_two(name: str, decibels: float) -> None:
    assert all(found is None for _, found in pushed(single()[name], decibels))


def test_the_end_of_the_second_tone_is_seen() -> None:
    t = times(9.0)
    pairs = pushed(tone(t) + second(t, 7.1, 0.4) * (t < 5.0))
    seen = [estimate.time for estimate, found in pairs if found is not None]
    assert 1.5 < seen[0] < 3.0
    assert 5.0 < seen[-1] < 6.0
    assert pairs[-1][0].quality == Quality.STEADY


def test_without_the_setting_none_is_looked_for() -> None:
    t = times(4.0)
    identifier = Identifier(with_(second_tone=0.0))
    assert all(found is None for _, found in pushed(tone(t) + second(t, 7.1, 0.4), identifier=identifier))
