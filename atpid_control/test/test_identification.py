# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identification on signals as they are: noise, hum, spikes, gaps, saturation, drift, steps and silence."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from identification_signals import AMPLITUDE, FREQUENCY, PERIOD, RATE, SETTINGS, estimates, noise, times, tone, with_

from atpid_control.identification import IdentificationError, Identifier, Quality
from atpid_sim.system import Array

#: Whether the whole bulk of random signals is looked at, or a sample of it.
LONG = settings.get_current_profile_name() == "long"
Spoil = Callable[[np.random.Generator, Array, Array], Array]


def _spikes(_rng: np.random.Generator, t: Array, u: Array) -> Array:
    u = u.copy()
    for first in range(90, t.size - 4, 91):  # two impacts a period
        u[first : first + 4] += 0.5 * AMPLITUDE * np.array([1.0, -0.6, 0.3, -0.1])
    return u


def _lost(rng: np.random.Generator, t: Array, u: Array) -> Array:
    return np.where(rng.random(t.size) < 0.1, np.nan, u)


SPOILED: dict[str, Spoil] = {
    "clean": lambda _rng, _t, u: u,
    "hum": lambda _rng, t, u: u + 0.5 * AMPLITUDE * np.sin(2 * np.pi * 50.0 * t + 1.0),
    "offset and drift": lambda _rng, t, u: u + 0.1 + 0.2 * AMPLITUDE * t,
    "harmonics": lambda _rng, t, u: (
        u + tone(t, 0.05 * AMPLITUDE, 2 * FREQUENCY) + tone(t, 0.03 * AMPLITUDE, 3 * FREQUENCY, 1.0)
    ),
    "single spikes": lambda rng, t, u: u + np.where(rng.random(t.size) < 0.01, rng.normal(0.0, AMPLITUDE, t.size), 0.0),
    "spikes of impacts": _spikes,
    "lost samples": _lost,
    "saturated, said": lambda _rng, _t, u: np.where(u > 0.8 * AMPLITUDE, np.nan, u),
    "saturated, not said": lambda _rng, _t, u: np.clip(u, -0.8 * AMPLITUDE, 0.8 * AMPLITUDE),
    "infinite readings": lambda rng, t, u: np.where(rng.random(t.size) < 0.01, np.inf, u),
    "quantised": lambda _rng, _t, u: np.round(u / (0.005 * AMPLITUDE)) * 0.005 * AMPLITUDE,
    "all at once": lambda rng, t, u: (
        _lost(rng, t, _spikes(rng, t, u)) + 0.1 * AMPLITUDE * np.sin(314.0 * t) + 0.1 * AMPLITUDE * t
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPOILED)
def test_a_steady_tone_is_steady_and_right_whatever_lies_on_top(name: str) -> None:
    rng, t = np.random.default_rng(7), times(8.0)
    found = estimates(SPOILED[name](rng, t, tone(t) + noise(rng, t.size, 40.0)))[20:]
    assert {e.quality for e in found} == {Quality.STEADY}
    assert not any(e.changed for e in found)
    assert max(abs(e.amplitude / AMPLITUDE - 1.0) for e in found) < 0.004
    assert max(abs(e.frequency / FREQUENCY - 1.0) for e in found) < 0.002
    # error bars are honest: neither too small nor useless
    assert 0.5 < np.sqrt(np.mean([((e.amplitude - AMPLITUDE) / e.amplitude_std) ** 2 for e in found])) < 1.7


@pytest.mark.slow
def test_no_false_change_in_minutes_of_steady_noise() -> None:
    """Five minutes are 6000 estimates; ten in a long run."""
    rng, t = np.random.default_rng(1), times(600.0 if LONG else 300.0)
    found = estimates(tone(t) + noise(rng, t.size, 40.0))
    assert [e.changed for e in found].index(True) < 10  # the start is a change from nothing
    assert {e.quality for e in found[8:]} == {Quality.STEADY}
    assert sum(e.changed for e in found[8:]) == 0


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.05, 1.1, 2.0])
def test_a_step_is_seen_within_a_period_and_over_after_two(factor: float) -> None:
    rng, t = np.random.default_rng(2), times(4.0)
    for start in 2.0 + rng.random(12 if LONG else 6):  # six phases of the tone and of the estimates
        u = tone(t, np.where(t < start, 1.0, factor) * AMPLITUDE, phase=rng.uniform(0.0, 6.0))
        after = [e for e in estimates(u + noise(rng, t.size, 40.0)) if e.time > start]
        assert next(e.time for e in after if e.changed) - start < 0.6 * PERIOD
        seen = next(e.time for e in after if e.changed)
        steady = [e for e in after if e.time >= seen and e.quality == Quality.STEADY]
        assert max(abs(e.amplitude / (factor * AMPLITUDE) - 1.0) for e in steady) < 0.015
        settled = [e for e in after if e.time > start + 2.0 * PERIOD]
        assert max(abs(e.amplitude / (factor * AMPLITUDE) - 1.0) for e in settled) < 0.01
        assert not any(e.changed for e in settled[6:])


def test_a_small_step_is_seen_within_one_period() -> None:
    rng, t = np.random.default_rng(3), times(4.0)
    for start in 2.0 + rng.random(12):
        u = tone(t, np.where(t < start, 1.0, 1.02) * AMPLITUDE, phase=rng.uniform(0.0, 6.0))
        after = [e for e in estimates(u + noise(rng, t.size, 40.0)) if e.time > start]
        assert next(e.time for e in after if e.changed) - start < 1.25 * PERIOD


def test_straight_ramps_are_transient_and_their_ends_exact() -> None:
    rng, t = np.random.default_rng(4), times(20.0)
    corners = [0.0, 0.5, 6.0, 8.0, 13.0, 14.0, 20.0]
    amplitude = np.interp(t, corners, [0.0, 0.015, 0.015, 0.04, 0.04, 0.03, 0.03])
    found = estimates(tone(t, amplitude) + noise(rng, t.size, 40.0))
    for begin, end, level in ((0.5, 6.0, 0.015), (8.0, 13.0, 0.04), (14.0, 20.0, 0.03)):
        steady = [e for e in found if begin + 2.0 * PERIOD < e.time < end]
        assert {e.quality for e in steady} == {Quality.STEADY}
        assert max(abs(e.amplitude / level - 1.0) for e in steady) < 0.01
    ramp = [e for e in found if 6.0 + 2.0 * PERIOD < e.time < 8.0]
    assert sum(e.quality == Quality.TRANSIENT for e in ramp) > 0.9 * len(ramp)
    middle = np.interp([e.time - 0.5 * e.window for e in ramp], corners, [0.0, 0.015, 0.015, 0.04, 0.04, 0.03, 0.03])
    assert max(abs(e.amplitude / a - 1.0) for e, a in zip(ramp, middle, strict=True)) < 0.02


def test_frequency_and_phase_jumps_are_changes() -> None:
    rng, t = np.random.default_rng(5), times(4.0)
    jump = np.where(t < 2.0, tone(t), tone(t, phase=1.3))
    faster = np.where(t < 2.0, tone(t), tone(t, frequency=1.05 * FREQUENCY))
    for signal in (jump, faster):
        found = estimates(signal + noise(rng, t.size, 40.0))
        assert any(e.changed for e in found if 2.0 < e.time < 2.3)
        assert found[-1].quality == Quality.STEADY


@pytest.mark.parametrize("silence", [0.0, np.nan, 0.02])
def test_without_a_tone_there_is_no_estimate(silence: float) -> None:
    rng, t = np.random.default_rng(6), times(5.0)
    found = estimates(np.full(t.size, silence) + (noise(rng, t.size, 40.0) if silence == 0.0 else 0.0))
    assert {e.quality for e in found} == {Quality.NONE}
    assert all(np.isnan(e.amplitude) and not e.changed for e in found)


def test_one_period_is_enough_and_less_is_not() -> None:
    t = times(1.0)
    found = estimates(tone(t), block=1)
    first = next(e for e in found if e.quality == Quality.STEADY)
    assert 0.95 * PERIOD < first.time < 1.1 * PERIOD
    assert first.amplitude == pytest.approx(AMPLITUDE, rel=1e-6)


def test_a_window_of_one_period_works() -> None:
    rng, t = np.random.default_rng(8), times(20.0)
    found = estimates(tone(t) + noise(rng, t.size, 40.0), with_(window_periods=1.0))[10:]
    assert {e.quality for e in found} == {Quality.STEADY}
    assert max(abs(e.amplitude / AMPLITUDE - 1.0) for e in found) < 0.005
    assert found[-1].window == pytest.approx(PERIOD, rel=0.02)


def test_gaps_are_detected_by_index() -> None:
    rng, t = np.random.default_rng(9), times(10.0)
    u, identifier = tone(t) + noise(rng, t.size, 40.0), Identifier(SETTINGS)
    for first in range(0, t.size, 50):
        if first == 5000:
            continue
        e = identifier.push(first, RATE, u[first : first + 50], None, t[first + 49])
        if first > 1000:
            assert e.quality == Quality.STEADY
            assert e.amplitude == pytest.approx(AMPLITUDE, rel=0.004)
            window = round(e.window * RATE)
            assert e.used + e.lost == window
            assert e.lost == (0 if first < 5000 else len(range(max(5000, first + 50 - window), 5050)))


def test_a_stream_that_starts_anew_replaces_the_old_one() -> None:
    t, identifier = times(1.0), Identifier(SETTINGS)
    identifier.push(0, RATE, tone(t), None, 1.0)
    assert identifier.push(0, RATE, tone(t)[:50], None, 2.0).quality == Quality.NONE
    assert identifier.push(50, RATE, tone(t, 0.03)[50:1000], None, 3.0).amplitude == pytest.approx(0.03, rel=1e-6)
    assert identifier.push(10_000_000, RATE, tone(t)[:50], None, 4.0).quality == Quality.NONE


def test_phase_is_that_at_the_last_sample_and_skew_is_taken_off() -> None:
    t, identifier = times(1.0), Identifier(SETTINGS)
    e = identifier.push(0, RATE, tone(t + 2e-4), None, t[-1], delay=2e-4)
    assert np.sin(e.phase) == pytest.approx(np.sin(2 * np.pi * FREQUENCY * t[-1] + 0.3), abs=1e-6)
    assert e.time == t[-1]
    assert e.last_index == 999


@pytest.mark.parametrize("rate", [2000.0, 7333.3, 50_000.0])
def test_fast_streams_are_averaged_down_without_bias(rate: float) -> None:
    rng, t = np.random.default_rng(10), times(2.0, rate)
    u = tone(t) + noise(rng, t.size, 40.0)
    e = estimates(u, block=round(0.05 * rate) + 7, rate=rate)[-1]
    assert e.quality == Quality.STEADY
    assert abs(e.amplitude - AMPLITUDE) < 5.0 * e.amplitude_std
    assert abs(np.angle(np.exp(1j * (e.phase - 2 * np.pi * FREQUENCY * t[-1] - 0.3)))) < 5.0 * e.phase_std
    assert e.amplitude_std < 0.002 * AMPLITUDE * np.sqrt(1000.0 / rate)


def test_the_beam_is_measured_beside() -> None:
    rng, t = np.random.default_rng(11), times(3.0)
    beam = tone(t, 0.1) - 0.01 + noise(rng, t.size, 40.0, 0.1)
    found = estimates(tone(t), beam=beam)
    assert found[-1].beam_amplitude == pytest.approx(0.1, rel=0.01)
    still = estimates(0.0 * t, beam=beam)
    assert still[-1].quality == Quality.NONE
    assert still[-1].beam_amplitude == pytest.approx(0.1, rel=0.01)
    assert np.isnan(estimates(tone(t))[-1].beam_amplitude)


def test_what_is_no_tone_is_poor_or_nothing() -> None:
    rng, t = np.random.default_rng(12), times(5.0)
    square = AMPLITUDE * np.sign(tone(t)) + noise(rng, t.size, 40.0)
    assert Quality.STEADY not in {e.quality for e in estimates(square)[10:]}
    buried = tone(t) + noise(rng, t.size, 2.0)
    assert Quality.STEADY not in {e.quality for e in estimates(buried)[10:]}


def test_bad_settings_and_samples_are_refused_in_one_line() -> None:
    with pytest.raises(IdentificationError, match=r"window_periods: given 0.5; allowed: at least 1"):
        with_(window_periods=0.5)
    with pytest.raises(IdentificationError, match="saturation"):
        with_(saturation=(1.0, 0.0))
    with pytest.raises(IdentificationError, match="rate: given 100 Hz"):
        Identifier(SETTINGS).push(0, 100.0, np.zeros(10), None, 0.1)
    with pytest.raises(IdentificationError, match="support: given no samples"):
        Identifier(SETTINGS).push(0, RATE, None, np.zeros(10), 0.1)


@pytest.mark.slow
@settings(max_examples=150 if LONG else 60, deadline=None)
@given(
    amplitude=st.floats(1e-3, 1.0), frequency=st.floats(1.05, 38.0), phase=st.floats(-3.2, 3.2),
    offset=st.floats(-10.0, 10.0), decibels=st.floats(20.0, 80.0), seed=st.integers(0, 1000),
)  # fmt: skip
def test_any_steady_tone_is_found(
    amplitude: float, frequency: float, phase: float, offset: float, decibels: float, seed: int
) -> None:
    rng, t = np.random.default_rng(seed), times(2.0)
    u = tone(t, amplitude, frequency, phase) + offset + noise(rng, t.size, decibels, amplitude)
    e = estimates(u)[-1]
    assert e.quality == Quality.STEADY
    assert abs(e.amplitude - amplitude) < 6.0 * e.amplitude_std
    assert abs(e.frequency - frequency) < 6.0 * e.frequency_std


@settings(max_examples=100, deadline=None)
@given(
    data=st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=0, max_size=400),
    block=st.integers(1, 400),
)
def test_no_samples_whatever_break_it(data: list[float], block: int) -> None:
    u = np.array(data, dtype=np.float64)
    for e in estimates(u, block=block):
        assert e.quality == Quality.NONE or np.isfinite(e.amplitude)
