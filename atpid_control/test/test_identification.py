# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identification on signals as they are, and its error bars; tests/of_studies counts how often the bars hold."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from identification_signals import AMPLITUDE, FREQUENCY, PERIOD, RATE, SETTINGS, estimates, noise, times, tone, with_
from made_signals import noise as white

from atpid_control.identification import Estimate, IdentificationError, Identifier, Origin, Quality
from atpid_control.identification.from_beam import ClosedBeam, ModelInverse, crossings, regular_branch
from atpid_control.identification.sine_fit import SineFit, fit_sine
from atpid_sim.scene import load_scene
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

TAU = 2.0 * math.pi
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
        u + tone(t, 0.05 * AMPLITUDE, 2 * FREQUENCY) + tone(t, 0.05 * AMPLITUDE, 3 * FREQUENCY, 1.0)
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


def test_no_false_change_in_minutes_of_steady_noise() -> None:
    """Five minutes are 6000 estimates; ten in a long run."""
    rng, t = np.random.default_rng(1), times(600.0 if LONG else 300.0)
    found = estimates(tone(t) + noise(rng, t.size, 40.0))
    assert [e.changed for e in found].index(True) < 10  # the start is a change from nothing
    assert {e.quality for e in found[8:]} == {Quality.STEADY}
    assert sum(e.changed for e in found[8:]) == 0


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.05, 1.1, 2.0, 1.02])
def test_a_step_is_seen_within_a_period_and_over_after_two(factor: float) -> None:
    rng, t, within = np.random.default_rng(2), times(4.0), 1.25 if factor == 1.02 else 0.6
    for start in 2.0 + rng.random(12 if LONG else 6):  # six phases of the tone and of the estimates
        u = tone(t, np.where(t < start, 1.0, factor) * AMPLITUDE, phase=rng.uniform(0.0, 6.0))
        after = [e for e in estimates(u + noise(rng, t.size, 40.0)) if e.time > start]
        seen = next(e.time for e in after if e.changed)
        assert seen - start < within * PERIOD
        assert abs(factor - 1.0) > 0.3 or Quality.POOR not in {e.quality for e in after}  # it is no cut crest
        steady = [e for e in after if e.time >= seen and e.quality == Quality.STEADY]
        assert max(abs(e.amplitude / (factor * AMPLITUDE) - 1.0) for e in steady) < 0.015
        settled = [e for e in after if e.time > start + 2.0 * PERIOD]
        assert max(abs(e.amplitude / (factor * AMPLITUDE) - 1.0) for e in settled) < 0.01
        assert not any(e.changed for e in settled[6:])


def test_straight_ramps_are_transient_and_their_ends_exact() -> None:
    rng, t = np.random.default_rng(4), times(20.0)
    course = [0.0, 0.5, 6.0, 8.0, 13.0, 14.0, 20.0], [0.0, 0.015, 0.015, 0.04, 0.04, 0.03, 0.03]
    found = estimates(tone(t, np.interp(t, *course)) + noise(rng, t.size, 40.0))
    for begin, end, level in ((0.5, 6.0, 0.015), (8.0, 13.0, 0.04), (14.0, 20.0, 0.03)):
        steady = [e for e in found if begin + 2.0 * PERIOD < e.time < end]
        assert {e.quality for e in steady} == {Quality.STEADY}
        assert max(abs(e.amplitude / level - 1.0) for e in steady) < 0.01
    ramp = [e for e in found if 6.0 + 2.0 * PERIOD < e.time < 8.0]
    assert sum(e.quality == Quality.TRANSIENT for e in ramp) > 0.9 * len(ramp)
    middle = np.interp([e.time - 0.5 * e.window for e in ramp], *course)
    assert max(abs(e.amplitude / a - 1.0) for e, a in zip(ramp, middle, strict=True)) < 0.02


def test_a_jump_of_the_phase_is_a_change() -> None:
    rng, t = np.random.default_rng(5), times(4.0)
    found = estimates(np.where(t < 2.0, tone(t), tone(t, phase=1.3)) + noise(rng, t.size, 40.0))
    assert any(e.changed for e in found if 2.0 < e.time < 2.3)
    assert found[-1].quality == Quality.STEADY


@pytest.mark.parametrize("silence", [0.0, np.nan, 0.02])
def test_without_a_tone_there_is_no_estimate(silence: float) -> None:
    rng, t = np.random.default_rng(6), times(5.0)
    found = estimates(np.full(t.size, silence) + (noise(rng, t.size, 40.0) if silence == 0.0 else 0.0))
    assert {e.quality for e in found} == {Quality.NONE}
    assert all(np.isnan(e.amplitude) and not e.changed for e in found)


def test_one_period_is_enough_and_less_is_not() -> None:
    first = next(e for e in estimates(tone(times(1.0)), block=1) if e.quality == Quality.STEADY)
    assert 0.95 * PERIOD < first.time < 1.1 * PERIOD
    assert first.amplitude == pytest.approx(AMPLITUDE, rel=1e-6)
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
    assert (e.time, e.last_index) == (t[-1], 999)


@pytest.mark.parametrize("rate", [2000.0, 7333.3, 50_000.0])
def test_fast_streams_are_averaged_down_without_bias(rate: float) -> None:
    rng, t = np.random.default_rng(10), times(2.0, rate)
    e = estimates(tone(t) + noise(rng, t.size, 40.0), block=round(0.05 * rate) + 7, rate=rate)[-1]
    assert e.quality == Quality.STEADY
    assert abs(e.amplitude - AMPLITUDE) < 5.0 * e.amplitude_std
    assert abs(np.angle(np.exp(1j * (e.phase - 2 * np.pi * FREQUENCY * t[-1] - 0.3)))) < 5.0 * e.phase_std
    assert e.amplitude_std < 0.002 * AMPLITUDE * np.sqrt(1000.0 / rate)


def test_the_beam_is_measured_beside() -> None:
    rng, t = np.random.default_rng(11), times(3.0)
    beam = tone(t, 0.1) - 0.01 + noise(rng, t.size, 40.0, 0.1)
    driven, still = estimates(tone(t), beam=beam)[-1], estimates(0.0 * t, beam=beam)[-1]
    assert (driven.quality, still.quality) == (Quality.STEADY, Quality.NONE)
    assert [driven.beam_amplitude, still.beam_amplitude] == pytest.approx([0.1, 0.1], rel=0.01)
    assert np.isnan(estimates(tone(t))[-1].beam_amplitude)


def test_what_is_no_tone_is_poor_or_nothing() -> None:
    rng, t = np.random.default_rng(12), times(5.0)
    square, buried = AMPLITUDE * np.sign(tone(t)) + noise(rng, t.size, 40.0), tone(t) + noise(rng, t.size, 2.0)
    assert Quality.STEADY not in {e.quality for signal in (square, buried) for e in estimates(signal)[10:]}


def test_bad_settings_and_samples_are_refused_in_one_line() -> None:
    identifier, samples = Identifier(SETTINGS), np.zeros(10)
    with pytest.raises(IdentificationError, match=r"^window_periods: .*0\.5; .*1 to 20$"):
        with_(window_periods=0.5)
    with pytest.raises(IdentificationError, match="saturation"):
        with_(saturation=(1.0, 0.0))
    with pytest.raises(IdentificationError, match=r"^rate: .*100 Hz"):
        identifier.push(0, 100.0, samples, None, 0.1)
    with pytest.raises(IdentificationError, match=r"^support: "):
        identifier.push(0, RATE, None, samples, 0.1)


@settings(max_examples=150 if LONG else 60, deadline=None)
@given(
    st.floats(1e-3, 1.0), st.floats(1.05, 38.0), st.floats(-3.2, 3.2), st.floats(-10.0, 10.0),
    st.floats(20.0, 80.0), st.integers(0, 1000),
)  # fmt: skip
def test_any_steady_tone_is_found(
    amplitude: float, frequency: float, phase: float, offset: float, decibels: float, seed: int
) -> None:
    rng, t = np.random.default_rng(seed), times(2.0)
    e = estimates(tone(t, amplitude, frequency, phase) + offset + noise(rng, t.size, decibels, amplitude))[-1]
    assert e.quality == Quality.STEADY
    assert abs(e.amplitude - amplitude) < 6.0 * e.amplitude_std
    assert abs(e.frequency - frequency) < 6.0 * e.frequency_std


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(width=32), max_size=400), st.integers(1, 400))
def test_no_samples_whatever_break_it(data: list[float], block: int) -> None:
    for e in estimates(np.array(data, dtype=np.float64), block=block):
        assert e.quality == Quality.NONE or np.isfinite(e.amplitude)


# noise with memory, and what no tone describes


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


def test_bars_in_noise_with_memory_cover_its_density_at_the_tone() -> None:
    rng, memory = np.random.default_rng(12), 0.9
    found = [fitted(rng, memory) for _ in range(200)]
    assert sum(one.widened > 1.0 for one in found) >= 198
    white = [fitted(np.random.default_rng(seed), 0.0, periods).widened for seed in range(200) for periods in (1.0, 2.0)]
    assert min(white) == 1.0
    assert sum(one > 1.0 for one in white) <= 3
    density = (1.0 - memory**2) / abs(1.0 - memory * np.exp(-1j * TAU * FREQUENCY / RATE)) ** 2
    expected = 0.01 * AMPLITUDE * math.sqrt(2.0 * density / (2.0 * PERIOD * RATE))
    # the largest that a likely noise gives: 1.5 times on the average
    assert 1.0 < np.median([one.amplitude_std for one in found]) / expected < 2.0


@pytest.mark.parametrize("spoiled", ["cut", "halved"])
def test_cut_crests_and_a_subharmonic_are_never_steady_and_end_with_their_cause(spoiled: str) -> None:
    rng, t = np.random.default_rng(13), times(6.0)
    signals = {
        "cut": np.clip(tone(t), -0.9 * AMPLITUDE, AMPLITUDE),
        "halved": tone(t) + tone(t, 0.05 * AMPLITUDE, 0.5 * FREQUENCY, 1.0),
    }
    found = estimates(np.where((t > 2.0) & (t < 4.0), signals[spoiled], tone(t)) + noise(rng, t.size, 50.0))
    inside = [e.quality for e in found if 2.0 + 2.0 * PERIOD < e.time < 4.0]
    assert set(inside) <= {Quality.POOR, Quality.TRANSIENT}
    assert inside.count(Quality.POOR) > 0.8 * len(inside)
    after = [e for e in found if e.time > 4.0 + 2.5 * PERIOD]
    assert {e.quality for e in after} == {Quality.STEADY}
    assert max(abs(e.amplitude / AMPLITUDE - 1.0) for e in after) < 0.005


# accelerations

UNITS = ("m/s^2", "m/s^2")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(2.0, 20.0), st.floats(4e-4, 0.02), st.floats(1e-4, 0.05))
def test_a_tone_is_identified_as_its_displacement(seed: int, frequency: float, amplitude: float, level: float) -> None:
    t, size = times(1.1), amplitude * (TAU * frequency) ** 2
    phase = np.random.default_rng(seed).uniform(-3.0, 3.0)
    samples = -size * np.sin(TAU * frequency * (t - t[-1]) + phase) + white(t.size, seed, level * size) + 0.3
    found = Identifier(SETTINGS).push(0, RATE, samples, samples, float(t[-1]), units=UNITS)
    assume(found.quality == Quality.STEADY)
    assert abs(found.amplitude - amplitude) < 5.0 * found.amplitude_std
    assert abs(found.frequency - frequency) < 5.0 * found.frequency_std
    assert abs(math.remainder(found.phase - phase, TAU)) < 5.0 * found.phase_std
    assert found.amplitude_std < 0.05 * amplitude
    assert found.beam_amplitude == pytest.approx(amplitude, rel=8.0 * level + 0.01)


def test_a_smaller_tone_than_the_least_is_none_and_one_too_slow_for_the_noise_refused_in_a_line() -> None:
    samples = 3e-5 * (TAU * 8.0) ** 2 * np.sin(TAU * 8.0 * times(1.5))
    found = [Identifier(SETTINGS).push(0, RATE, samples, None, 1.5, units=units) for units in (UNITS, ("m", "m"))]
    assert [one.quality for one in found] == [Quality.NONE, Quality.STEADY]
    slow = Identifier(with_(lowest_frequency=0.8, highest_frequency=20.0))
    samples = 2e-3 * (TAU * 1.2) ** 2 * np.sin(TAU * 1.2 * times(3.0)) + white(3000, 3, 0.2)
    with pytest.raises(IdentificationError, match=r"^acceleration: [^\n]*1\.[12]\d* Hz [^\n]*0\.2\d* m/s\^2[^\n]*$"):
        slow.push(0, RATE, samples, None, 3.0, units=UNITS)


# a frequency that drifts

DRIFTING = with_(slow_drift=0.03)


def chirp(t: Array, rate: float) -> tuple[Array, Array]:
    """Return a tone (n,) [m] that drifts by `rate` [1/s] from the first second on, and its frequency [Hz]."""
    frequency = FREQUENCY * (1.0 + rate * np.clip(t - 1.0, 0.0, None))
    return AMPLITUDE * np.sin(TAU * np.cumsum(frequency) / RATE), frequency


@pytest.mark.parametrize("rate", [0.01, -0.01])
@pytest.mark.parametrize("decibels", [20.0, 40.0, 60.0, 100.0])
def test_one_per_cent_a_second_is_followed_at_any_noise_without_a_step(rate: float, decibels: float) -> None:
    t = times(10.0)
    signal, true = chirp(t, rate)
    found = estimates(signal + noise(np.random.default_rng(3), t.size, decibels), DRIFTING)
    assert sum(one.changed for one in found if one.quality == Quality.STEADY) == 1  # the first: from nothing
    late = [one for one in found if one.time > 2.0]
    assert {one.quality for one in late} == {Quality.STEADY}
    at = [one.last_index for one in late]
    frequency, amplitude = (np.array([getattr(one, name) for one in late]) for name in ("frequency", "amplitude"))
    # where noise hides the drift inside a window, the estimate is that of its middle, 0.18 s ago
    assert abs((frequency / true[at] - 1.0).mean()) < (0.003 if decibels <= 40.0 else 2e-5)
    assert np.abs(amplitude / AMPLITUDE - 1.0).max() < 10.0 ** (-decibels / 20.0) + 1e-3
    if (rate, decibels) == (0.01, 60.0):  # error bars hold for the frequency and its phase
        assert np.mean([one.drift for one in late]) == pytest.approx(0.0095, abs=0.0005)  # a tenth less at the end
        assert 0.6 < np.std((frequency - true[at]) / [one.frequency_std for one in late]) < 1.4
        assert 0.4 < np.std((amplitude - AMPLITUDE) / [one.amplitude_std for one in late]) < 1.6
        spread = np.array([np.hypot(one.amplitude_std, AMPLITUDE * one.phase_std) for one in late])
        assert (np.abs(amplitude * np.sin([one.phase for one in late]) - signal[at]) < 5.0 * spread).all()


def test_a_faster_change_and_one_of_the_amplitude_stay_transient_and_so_does_a_drift_without_the_setting() -> None:
    t = times(6.0)
    growing = (1.0 + 0.2 * t) * tone(t, phase=0.0)
    for signal, judged_by in ((chirp(t, 0.1)[0], DRIFTING), (growing, DRIFTING), (chirp(t, 0.01)[0], SETTINGS)):
        assert {one.quality for one in estimates(signal, judged_by) if one.time > 2.0} == {Quality.TRANSIENT}


@pytest.mark.parametrize("step", [0.02, -0.05, 0.3])
def test_a_step_of_the_frequency_is_one_change(step: float) -> None:
    t = times(6.0)
    frequency = np.where(t < 3.0, FREQUENCY, FREQUENCY * (1.0 + step))
    signal = AMPLITUDE * np.sin(TAU * np.cumsum(frequency) / RATE)
    found = estimates(signal + noise(np.random.default_rng(5), t.size, 60.0), DRIFTING)
    _, end = (one.time for one in found if one.changed and one.quality == Quality.STEADY)
    assert 3.0 < end < 3.6
    assert found[-1].frequency == pytest.approx(frequency[-1], rel=1e-3)


# from the beam alone: closed and open damper, still swinging up, and where it is not determined

DAMPER = load_scene(Path(__file__).parents[2] / "scenes" / "closed_damper.yaml")
SCENE = DAMPER.with_(duration=12.0, steady_window=(10.0, 12.0))
CLOSED, TRUE = 0.017, 0.01


@cache
def beam(height: float) -> Array:
    motion = trajectory(SCENE.with_(height=height), RATE).beam
    size = 0.5 * (motion[-1000:].max() - motion[-1000:].min())
    return np.asarray(motion + np.random.default_rng(1).normal(0.0, size / np.sqrt(2.0) * 0.01, motion.size))


def inferred(height: float, stiffness: float = 1.0) -> list[Estimate]:
    scene = SCENE.with_(beam={**SCENE.beam.model_dump(), "stiffness": stiffness * SCENE.beam.stiffness})
    identifier, signal = Identifier(SETTINGS, ModelInverse.of_scene(scene)), beam(height)
    return [
        identifier.push(first, RATE, None, signal[first : first + 50], (first + 49) / RATE, height=height)
        for first in range(0, signal.size, 50)
    ]


def test_the_closed_damper_is_inverted_within_its_error_bar_while_the_amplitude_grows() -> None:
    found = inferred(CLOSED)
    late = [e for e in found if e.time > 2.0]  # the beam itself needs 6 s to settle
    assert {e.origin for e in found} == {Origin.BEAM}
    assert all(abs(e.amplitude - TRUE) < 2.5 * e.amplitude_std for e in late)
    assert np.median([abs(e.amplitude / TRUE - 1.0) for e in late]) < 0.01
    assert sum(e.quality == Quality.STEADY for e in late) > 0.8 * len(late)
    # the model's own uncertainty is most of the error bar, and said
    assert 0.03 < np.median([e.amplitude_std / e.amplitude for e in late]) < 0.08


@pytest.mark.parametrize("height", [0.08, 0.15])
def test_the_open_damper_is_inverted_by_simulated_amplitudes(height: float) -> None:
    late = [e for e in inferred(height) if e.time > 8.0]
    assert {e.quality for e in late} == {Quality.STEADY}
    assert all(abs(e.amplitude - TRUE) < min(2.0 * e.amplitude_std, 0.03 * TRUE) for e in late)
    assert all(np.isnan(e.phase) for e in late)


def test_a_wrong_model_is_covered_by_the_error_bar_and_without_a_height_there_is_no_estimate() -> None:
    late = [e for e in inferred(CLOSED, stiffness=1.005) if e.time > 8.0]
    assert all(abs(e.amplitude - TRUE) < 3.0 * e.amplitude_std for e in late)
    identifier = Identifier(SETTINGS, ModelInverse.of_scene(SCENE))
    parts = ((first, beam(CLOSED)[first : first + 50]) for first in range(0, 3000, 50))
    unknown = [identifier.push(first, RATE, None, part, 0.0) for first, part in parts]
    assert {e.quality for e in unknown} == {Quality.NONE}
    assert unknown[-1].beam_amplitude > 0.1


def test_two_support_amplitudes_for_one_response_are_a_wide_and_poor_answer() -> None:
    support = np.linspace(0.0, 0.1, 21)
    folded = support, support * (0.1 - support) * 40.0, np.full(21, 1e-4)
    closed = ClosedBeam(0.362, 427.6, 0.56)
    inverse = ModelInverse(closed, CLOSED, lambda _height: folded)
    seen = Estimate(
        quality=Quality.STEADY, amplitude=0.08, amplitude_std=1e-4, frequency=1.0 / PERIOD, frequency_std=1e-3,
        phase=0.0, phase_std=0.01, window=2 * PERIOD, growth=0.0, growth_std=0.01, origin=Origin.BEAM,
    )  # fmt: skip
    answer = inverse.support_of(seen, 0.2)
    assert answer.quality == Quality.POOR
    assert answer.amplitude_std > 0.02
    assert np.isnan(inverse.support_of(replace(seen, amplitude=0.3), 0.2).amplitude)
    # the transfer of one mass
    resonance, ratio = np.sqrt(427.6 / 0.362), 0.56 / np.sqrt(427.6 * 0.362)
    assert 1.0 / abs(closed.inverse(resonance)) == pytest.approx(np.hypot(1.0, ratio) / ratio, rel=1e-9)
    assert abs(closed.inverse(1e-6)) == pytest.approx(1.0, rel=1e-9)


def test_intervals_and_branches() -> None:
    support = np.linspace(0.0, 1.0, 11)
    ends = crossings(support, support, np.zeros(11), 0.5, 0.01)
    assert len(ends) == 1
    assert ends[0][0] < 0.5 < ends[0][1] < 0.52
    assert crossings(support, support, np.zeros(11), 2.0, 0.01) == []
    branch = regular_branch(np.array([5.0, 5.0, 3.0, 4.0, 5.0]), np.array([1.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(branch, [np.nan, 2.0, 3.0, 4.0, 5.0])
