# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rumble is seen in the simulated beam within a few periods, and never while ramps and travels are merely fast."""

import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from atpid_control.loop.drift import OVERSHOOT, DriftAlarm, DriftSettings, SteadyTwin, WatchError
from atpid_control.loop.rumble import RumbleSettings, RumbleWatch, scatter_of
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import load_scene
from atpid_sim.system import Array

ROOT = Path(__file__).parents[2]
SCENE = load_scene(ROOT / "scenes" / "thesis_4_3.yaml")
FREQUENCY, RATE, BLOCK = SCENE.frequency_hz, 1000.0, 50
PERIOD = 1.0 / FREQUENCY
SETTINGS = RumbleSettings(onset=0.06, calm=0.03, calm_periods=3, least_amplitude=0.002)

#: Commands (t [s], h [m]) for thesis 4.3: heights a little below the best ones, and above them.
SAFE = ((1.0, 0.28), (8.0, 0.74), (13.1, 0.55))
HIGH = ((1.0, 0.33), (8.0, 0.85), (13.1, 0.65))


@cache
def beam(commands: tuple[tuple[float, float], ...], seconds: float = 20.0) -> Array:
    plant, parts = Plant(SCENE), []
    for k in range(round(seconds * RATE) // BLOCK):
        height = [0.017, *(h for t, h in commands if t <= k * BLOCK / RATE)][-1]
        parts.append(plant.advance(BLOCK, RATE, height, 0.3).beam)
    return np.concatenate(parts)


def watched(signal: Array, settings: RumbleSettings = SETTINGS) -> list[tuple[float, bool]]:
    watch = RumbleWatch(settings)
    return [
        ((first + BLOCK) / RATE, watch.push(first, RATE, signal[first : first + BLOCK], FREQUENCY).rumbling)
        for first in range(0, signal.size, BLOCK)
    ]


@pytest.mark.parametrize("seed", range(5))
def test_no_false_alarm_while_excitation_ramps_and_ceiling_travels(seed: int) -> None:
    noise = 0.0 if seed == 0 else 0.01 * 0.07 / np.sqrt(2.0)  # 40 dB of the smallest steady response
    signal = beam(SAFE) + np.random.default_rng(seed).normal(0.0, noise, beam(SAFE).size)
    assert not any(rumbling for _, rumbling in watched(signal))


def test_rumble_is_seen_within_four_periods_and_does_not_flicker() -> None:
    """`onset` is the first period whose amplitude breaks off the smooth course."""
    states = watched(beam(HIGH))
    for begin, end, onset in ((3.0, 6.0, 4.2), (9.9, 13.0, 11.15), (13.9, 20.0, 13.9)):
        seen = next(t for t, rumbling in states if rumbling and begin < t < end)
        assert seen - onset < 4.0 * PERIOD
    late = [rumbling for t, rumbling in states if t > 14.0]
    assert sum(a != b for a, b in pairwise(late)) <= 2


def test_it_ends_when_the_ceiling_has_stepped_back() -> None:
    states = dict(watched(beam(((1.0, 0.33), (4.6, 0.27)), 8.0)))
    assert any(rumbling for t, rumbling in states.items() if 4.3 < t < 4.7)
    calm = min(t for t, rumbling in states.items() if t > 4.6 and not rumbling)
    assert calm < 4.6 + 12.0 * PERIOD
    assert not any(rumbling for t, rumbling in states.items() if t >= calm)


def test_motion_that_repeats_every_second_period_grows_or_decays_is_smooth() -> None:
    k = np.arange(8)
    assert scatter_of(0.07 * np.resize(np.array([1.1, 0.9]), 8)) < 0.01
    for course in (np.exp(-0.1 * k), np.exp(0.1 * k), 1.0 - 0.6 * np.exp(-0.3 * k), 1.0 + np.exp(-0.4 * k)):
        assert scatter_of(0.1 * course) < 0.75 * SETTINGS.onset


def test_gaps_and_silence_are_not_judged() -> None:
    watch, signal = RumbleWatch(SETTINGS), beam(HIGH)
    for first in range(0, 6000, BLOCK):
        watch.push(first, RATE, signal[first : first + BLOCK], FREQUENCY)
    assert watch.state.rumbling
    assert np.isnan(watch.push(7000, RATE, signal[7000:7050], FREQUENCY).scatter)
    assert not watch.state.rumbling
    assert not watch.push(7050, RATE, np.full(50, np.nan), np.nan).rumbling
    for first in range(7100, 10_000, BLOCK):
        assert np.isnan(watch.push(first, RATE, np.full(BLOCK, np.nan), FREQUENCY).scatter)


def test_settings_without_hysteresis_are_refused() -> None:
    with pytest.raises(WatchError, match=r"^calm: .*0\.1; .* 0 .*onset"):
        RumbleSettings(onset=0.06, calm=0.1, calm_periods=3, least_amplitude=0.0)
    with pytest.raises(WatchError, match=r"^tolerance: .*\b0\b"):
        DriftAlarm(DriftSettings(0.0, 0.01, 1000.0))


def run_length(drift: float, threshold: float, noise: float) -> float:
    """Return the mean number of periods until one side alarms (Siegmund's approximation).

    `drift` is the mean of what a period adds, deviation less tolerance, `threshold` and `noise` as it, all [-].
    """
    b = threshold / noise + OVERSHOOT
    delta = drift / noise
    if abs(delta * b) < 1e-6:
        return b * b
    return (math.exp(-2.0 * delta * b) + 2.0 * delta * b - 1.0) / (2.0 * delta * delta)


def test_drift_alarms_come_as_late_and_as_rarely_as_specified() -> None:
    tolerance, noise, periods = 0.05, 0.01, 400.0
    rng = np.random.default_rng(3)

    def lasted(deviation: float, runs: int) -> float:
        lengths = []
        for _ in range(runs):
            alarm, n = DriftAlarm(DriftSettings(tolerance, noise, periods)), 0
            while not alarm.state.alarm and n < 20_000:
                alarm.push(0.1, 0.1 * float(np.exp(np.log1p(deviation) + rng.normal(0.0, noise))))
                n += 1
            lengths.append(n)
        return float(np.mean(lengths))

    threshold = DriftAlarm(DriftSettings(tolerance, noise, periods)).threshold
    for deviation, runs in ((0.05, 300), (0.08, 300), (0.15, 100)):
        expected = run_length(float(np.log1p(deviation) - np.log1p(tolerance)), threshold, noise)
        assert lasted(deviation, runs) == pytest.approx(expected, rel=0.25, abs=1.0)
    assert lasted(0.0, 3) == 20_000


def test_drift_waits_for_settled_periods_and_can_be_reset() -> None:
    alarm = DriftAlarm(DriftSettings(0.05, 0.01, 1000.0))
    for _ in range(100):
        assert not alarm.push(np.nan, 0.2).alarm
    for _ in range(3):
        state = alarm.push(0.1, 0.08)
    assert state.alarm
    assert state.deviation == pytest.approx(-0.2)
    alarm.reset()
    assert not alarm.state.alarm


def test_the_twin_follows_the_beam_and_a_lost_tenth_of_the_grain_is_noticed() -> None:
    twin = SteadyTwin(SCENE)
    settled = beam(SAFE)[-1000:]
    measured = 0.5 * (settled.max() - settled.min())
    assert twin.expected(0.03, FREQUENCY, 0.55) == pytest.approx(measured, rel=0.01)
    other = SteadyTwin(SCENE.with_(mass_fraction=0.09, frequency=FREQUENCY)).expected(0.03, FREQUENCY, 0.55)
    alarm, periods = DriftAlarm(DriftSettings(0.05, 0.01, 10_000.0)), 0
    while not alarm.state.alarm and periods < 30:
        alarm.push(twin.expected(0.03, FREQUENCY, 0.55), other)
        periods += 1
    assert alarm.state.alarm
    assert periods < 15
    closed = SCENE.linear_amplitude(0.03, FREQUENCY, grain=True)
    assert twin.expected(0.03, FREQUENCY, 0.0) == pytest.approx(closed, rel=0.01)
    assert np.isnan(twin.expected(np.nan, FREQUENCY, 0.55))
    assert np.isnan(twin.expected(0.015, FREQUENCY, 0.4))
