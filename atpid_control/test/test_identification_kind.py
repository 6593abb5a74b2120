# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Excitations other than one tone are named; whatever a single tone does is not taken for one of them."""

import re
from itertools import product

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY, RATE, noise, times, tone, with_

from atpid_control.identification import Estimate, Identifier, Quality
from atpid_control.identification.excitation_kind import OtherExcitation
from atpid_sim.system import Array

SETTINGS = with_(second_tone=0.1, slow_drift=0.03)
Pushed = list[tuple[Estimate, OtherExcitation | None]]


def pushed(signal: Array, decibels: float = 57.0, identifier: Identifier | None = None) -> Pushed:
    """Return each estimate of a signal with noise, and what else excites at that moment."""
    identifier, found = identifier or Identifier(SETTINGS), []
    noisy = signal + noise(np.random.default_rng(2), signal.size, decibels)
    for first in range(0, signal.size, 50):
        part = noisy[first : first + 50]
        estimate = identifier.push(first, RATE, part, None, (first + part.size - 1) / RATE)
        found.append((estimate, identifier.other))
    return found


def kinds(signal: Array, decibels: float = 57.0, identifier: Identifier | None = None) -> list[str]:
    """Return what is named in a signal, in the order of the estimates."""
    return [found.kind for _, found in pushed(signal, decibels, identifier) if found is not None]


def second(t: Array, frequency: float, share: float) -> Array:
    return tone(t, share * AMPLITUDE, frequency, 1.0)


#: Frequency and share of a second tone, all looked at in much noise, and the extremes and one between in little.
SECOND = [[(2.2, 0.2)], *([one] for one in product([3.9, 6.4, 7.1, 9.0], [0.2, 1.0]))]
MORE = [(3.2, 0.4), (8.0, 0.3), (13.0, 0.6)]


@pytest.mark.parametrize(
    ("others", "decibels"), [*product(SECOND, [20.0]), *product([*SECOND[::4], MORE[:2], MORE], [57.0])]
)
def test_up_to_four_tones_are_named_within_seconds(others: list[tuple[float, float]], decibels: float) -> None:
    begin = 3.0 if len(others) == 1 else 4.5
    t = times(begin + 0.5)
    signal = tone(t) + np.sum([second(t, *one) for one in others], axis=0)
    late = [pair for pair in pushed(signal, decibels) if pair[0].time > begin]
    assert {estimate.quality for estimate, _ in late} == {Quality.POOR}
    found = late[-1][1]
    assert found is not None
    assert found.kind == "tones"
    frequencies, shares = zip((FREQUENCY, 1.0), *others, strict=True)
    assert sorted(found.frequencies) == pytest.approx(sorted(frequencies), rel=5e-3)
    largest_first = sorted((share * AMPLITUDE for share in shares), reverse=True)
    assert sorted(found.amplitudes, reverse=True) == pytest.approx(largest_first, rel=0.05)
    number = {2: "two", 3: "three", 4: "four"}[len(shares)]
    line = rf"{number} tones [^\n]*(?: [0-9.e-]+ N at [0-9.]+ Hz[^\n]*){{{len(shares)}}}"
    assert re.fullmatch(line, found.sentence("N"))


@pytest.mark.parametrize("grows", [0.5, 2.0])
def test_two_tones_that_grow_are_called_nothing_else_before(grows: float) -> None:
    t = times(6.0)
    found = kinds(np.clip(t / grows, 0.0, 1.0) * (tone(t) + second(t, 7.1, 0.4)))
    assert set(found) == {"tones"}
    assert len(found) > 40


def random_signal(seed: int, low: float, high: float, seconds: float = 9.0) -> Array:
    """Return a Gaussian signal of even density between two frequencies [Hz]."""
    generator, count = np.random.default_rng(seed), round(2 * seconds * RATE)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    lines = generator.standard_normal((frequency.size, 2)) @ np.array([1.0, 1.0j])
    signal = np.fft.irfft(np.where((frequency >= low) & (frequency <= high), lines, 0.0), count)[: count // 2]
    return np.asarray(AMPLITUDE * signal / signal.std())


@pytest.mark.parametrize(("low", "high"), [(2.0, 20.0), (4.0, 8.0), (1.0, 40.0), (10.0, 40.0)])
def test_a_random_signal_is_named_and_no_estimate_of_it_is_steady(low: float, high: float) -> None:
    late = [pair for pair in pushed(random_signal(0, low, high)) if pair[0].time > 5.0]
    assert np.mean([found is not None and found.kind == "random" for _, found in late]) > 0.97
    assert sum(estimate.quality == Quality.STEADY for estimate, _ in late) < 0.005 * len(late)
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


def single() -> dict[str, Array]:
    """Return signals of one tone, whatever it does."""
    t = times(6.0)
    frequencies = {
        "frequency steps": np.where(t < 4.0, 1.0, 1.3),
        "frequency drifts": 1.0 + 0.01 * t,
        "frequency sweeps": 1.0 + 0.2 * np.clip(t - 2.0, 0.0, None),
    }
    turning = {name: tone(np.cumsum(ratio) / RATE, phase=0.0) for name, ratio in frequencies.items()}
    return turning | {
        "steady": tone(t),
        "ramp": tone(t, AMPLITUDE * (1.0 + 0.5 * np.clip(t - 3.0, 0.0, 2.0))),
        "step up": tone(t, np.where(t > 4.0, 2.0 * AMPLITUDE, AMPLITUDE)),
        "step down": tone(t, np.where(t > 4.0, 0.3 * AMPLITUDE, AMPLITUDE)),
        "harmonic": tone(t) + second(t, 2.0 * FREQUENCY, 0.3),
        "hum": tone(t) + second(t, 50.0, 0.3),
        "beat": tone(t) + second(t, FREQUENCY + 0.3, 0.4),
        "weak": tone(t) + second(t, 7.1, 0.05),
    }


@pytest.mark.parametrize(
    ("name", "decibels"), [*product(single(), [60.0]), *product(["steady", "weak", "beat", "frequency sweeps"], [20.0])]
)
def test_one_tone_is_never_taken_for_two(name: str, decibels: float) -> None:
    assert kinds(single()[name], decibels) == []


def test_the_end_of_the_second_tone_is_seen_and_a_burst_is_no_shock() -> None:
    t = times(9.0)
    both = tone(t) + second(t, 7.1, 0.4) * (t < 5.0)
    pairs = pushed(both)
    seen = [estimate.time for estimate, found in pairs if found is not None]
    assert 1.5 < seen[0] < 3.0
    assert 5.0 < seen[-1] < 6.0
    assert pairs[-1][0].quality == Quality.STEADY
    assert kinds(both, identifier=Identifier(with_(second_tone=0.0))) == []  # without the setting none is looked for
    assert "shock" not in kinds(tone(t) * ((t > 4.0) & (t < 5.5)))
