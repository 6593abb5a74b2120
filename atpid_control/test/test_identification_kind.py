# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two tones are refused with a sentence; whatever a single tone does is not taken for two."""

from itertools import product

import numpy as np
import pytest
from hypothesis import settings
from identification_signals import AMPLITUDE, FREQUENCY, RATE, noise, times, tone, with_

from atpid_control.identification import Estimate, Identifier, Quality
from atpid_control.identification.excitation_kind import OtherExcitation
from atpid_sim.system import Array

SETTINGS = with_(second_tone=0.1, slow_drift=0.03)


def pushed(
    signal: Array, decibels: float = 57.0, identifier: Identifier | None = None
) -> list[tuple[Estimate, OtherExcitation | None]]:
    """Return each estimate of a signal with noise, and the two tones at that moment."""
    identifier, found = identifier or Identifier(SETTINGS), []
    noisy = signal + noise(np.random.default_rng(2), signal.size, decibels)
    for first in range(0, signal.size, 50):
        part = noisy[first : first + 50]
        estimate = identifier.push(first, RATE, part, None, (first + part.size - 1) / RATE)
        found.append((estimate, identifier.other))
    return found


def second(t: Array, frequency: float, share: float) -> Array:
    return share * AMPLITUDE * np.sin(2.0 * np.pi * frequency * t + 1.0)


LONG = settings.get_current_profile_name() == "long"
#: Frequency and share of a second tone, all looked at in much noise, and the extremes and one between in little.
OTHERS = [(2.2, 0.2), *product([3.9, 6.4, 7.1, 9.0], [0.2, 1.0])]


@pytest.mark.parametrize(
    ("frequency", "share", "decibels"),
    [*((*one, 20.0) for one in OTHERS), *((*one, 57.0) for one in (OTHERS if LONG else OTHERS[::4]))],
)
def test_two_tones_are_named_within_three_seconds(frequency: float, share: float, decibels: float) -> None:
    t = times(3.5)
    late = [pair for pair in pushed(tone(t) + second(t, frequency, share), decibels) if pair[0].time > 3.0]
    assert all(estimate.quality == Quality.POOR for estimate, _ in late)
    found = late[-1][1]
    assert found is not None
    assert sorted(found.frequencies) == pytest.approx(sorted([FREQUENCY, frequency]), rel=5e-3)
    assert sorted(found.amplitudes) == pytest.approx(sorted([AMPLITUDE, share * AMPLITUDE]), rel=0.05)
    assert "two tones excite the structure" in found.sentence("m")
    assert "\n" not in found.sentence("m")


@pytest.mark.parametrize("grows", [0.5, 2.0])
def test_two_tones_that_grow_are_called_nothing_else_before(grows: float) -> None:
    t = times(6.0)
    grown = np.clip(t / grows, 0.0, 1.0) * (tone(t) + second(t, 7.1, 0.4))
    kinds = [found.kind for _, found in pushed(grown) if found is not None]
    assert set(kinds) == {"tones"}
    assert len(kinds) > 40


def single() -> dict[str, Array]:
    """Return signals of one tone, whatever it does."""
    t = times(6.0)

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


@pytest.mark.parametrize("count", [3, 4])
def test_more_tones_are_named(count: int) -> None:
    t, frequencies, shares = times(5.0), [FREQUENCY, 3.2, 8.0, 13.0][:count], [1.0, 0.4, 0.3, 0.6][:count]
    estimate, found = pushed(np.sum([second(t, f, a) for f, a in zip(frequencies, shares, strict=True)], axis=0))[-1]
    assert estimate.quality == Quality.POOR
    assert found is not None
    assert sorted(found.frequencies) == pytest.approx(sorted(frequencies), rel=5e-3)
    assert found.amplitudes == pytest.approx(sorted((a * AMPLITUDE for a in shares), reverse=True), rel=0.05)
    assert {3: "three", 4: "four"}[count] + " tones excite" in found.sentence("N")


def random_signal(seed: int, low: float, high: float, seconds: float = 12.0) -> Array:
    """Return a Gaussian signal of even density between two frequencies [Hz]."""
    generator, count = np.random.default_rng(seed), round(2 * seconds * RATE)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    lines = generator.standard_normal((frequency.size, 2)) @ np.array([1.0, 1.0j])
    signal = np.fft.irfft(np.where((frequency >= low) & (frequency <= high), lines, 0.0), count)[: count // 2]
    return np.asarray(AMPLITUDE * signal / signal.std())


@pytest.mark.parametrize(("low", "high"), [(2.0, 20.0), (4.0, 8.0), (1.0, 40.0), (10.0, 40.0)])
def test_a_random_signal_is_named_and_no_estimate_of_it_is_steady(low: float, high: float) -> None:
    seeds = range(2 if LONG else 1)
    late = [pair for seed in seeds for pair in pushed(random_signal(seed, low, high)) if pair[0].time > 5.0]
    named = [found is not None and found.kind == "random" for _, found in late]
    assert np.mean(named) > 0.97
    steady = [estimate for estimate, _ in late if estimate.quality == Quality.STEADY]
    assert len(steady) < 0.005 * len(late)
    last = late[-1][1]
    assert last is not None
    assert last.amplitudes[0] == pytest.approx(AMPLITUDE, rel=0.5)


@pytest.mark.parametrize("lasts", [0.03, 0.3, 1.5])
def test_a_shock_is_named_once_it_is_over(lasts: float) -> None:
    t = times(9.0)
    inside = (t > 4.0) & (t < 4.0 + lasts)
    pulse = AMPLITUDE * np.where(inside, np.sin(np.pi * (t - 4.0) / lasts), 0.0)
    shocks = [(estimate.time, found) for estimate, found in pushed(pulse) if found is not None]
    assert {found.kind for _, found in shocks} == {"shock"}
    assert 4.0 + lasts + 0.9 < shocks[0][0] < 4.0 + lasts + 3.5
    assert shocks[0][1].amplitudes[0] == pytest.approx(AMPLITUDE, rel=0.1)
    assert shocks[0][1].lasted == pytest.approx(lasts, abs=0.15)


def test_a_burst_of_a_tone_is_no_shock() -> None:
    t = times(9.0)
    burst = tone(t) * ((t > 4.0) & (t < 5.5))
    assert all(found is None or found.kind != "shock" for _, found in pushed(burst))


NOISY = list(single()) if LONG else ["steady", "weak", "beat", "frequency sweeps"]


@pytest.mark.parametrize(
    ("name", "decibels"),
    [*((name, 60.0) for name in single()), *((name, 20.0) for name in NOISY)],
)
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
