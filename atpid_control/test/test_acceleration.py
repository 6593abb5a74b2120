# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Displacement from an acceleration: a tone's, identified, and a record's, integrated."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from identification_signals import SETTINGS, times
from made_signals import noise

from atpid_control.analysis import AnalysisError, Signals
from atpid_control.analysis.integration import displacement_of, integrated
from atpid_control.identification import IdentificationError, Identifier, Quality

TAU, UNITS = 2.0 * math.pi, ("m/s^2", "m/s^2")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(2.0, 20.0), st.floats(4e-4, 0.02), st.floats(1e-4, 0.05))
def test_a_tone_is_identified_as_its_displacement(seed: int, frequency: float, amplitude: float, level: float) -> None:
    t, size = times(1.1), amplitude * (TAU * frequency) ** 2
    phase = np.random.default_rng(seed).uniform(-3.0, 3.0)
    samples = -size * np.sin(TAU * frequency * (t - t[-1]) + phase) + noise(t.size, seed, level * size) + 0.3
    found = Identifier(SETTINGS).push(0, 1000.0, samples, samples, float(t[-1]), units=UNITS)
    if found.quality != Quality.STEADY:
        return
    assert abs(found.amplitude - amplitude) < 5.0 * found.amplitude_std
    assert abs(found.frequency - frequency) < 5.0 * found.frequency_std
    assert abs(math.remainder(found.phase - phase, TAU)) < 5.0 * found.phase_std
    assert found.amplitude_std < 0.05 * amplitude
    assert found.beam_amplitude == pytest.approx(amplitude, rel=8.0 * level + 0.01)


def test_a_smaller_tone_than_the_least_is_none() -> None:
    t = times(1.5)
    samples = 3e-5 * (TAU * 8.0) ** 2 * np.sin(TAU * 8.0 * t)
    assert Identifier(SETTINGS).push(0, 1000.0, samples, None, 1.5, units=UNITS).quality == Quality.NONE
    assert Identifier(SETTINGS).push(0, 1000.0, samples, None, 1.5).quality == Quality.STEADY


def test_a_tone_too_slow_for_the_noise_is_refused_in_a_line() -> None:
    t = times(3.0)
    samples = 2e-3 * (TAU * 1.2) ** 2 * np.sin(TAU * 1.2 * t) + noise(t.size, 3, 0.2)
    slow = replace(SETTINGS, lowest_frequency=0.8, highest_frequency=20.0)
    with pytest.raises(
        IdentificationError, match=r"tone at 1\.[12]\d* Hz in noise of 0\.2\d* m/s\^2.*excite above"
    ) as caught:
        Identifier(slow).push(0, 1000.0, samples, None, 3.0, units=UNITS)
    assert "\n" not in str(caught.value)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(2.5, 40.0), st.floats(0.0, 0.1), st.floats(0.4, 1.0))
def test_a_record_is_integrated_to_within_its_drift(seed: int, frequency: float, level: float, corner: float) -> None:
    t, omega = times(40.0), TAU * frequency
    true = 5e-3 * np.sin(omega * t + seed)
    found, drift = displacement_of(-(omega**2) * true + noise(t.size, seed, level) + 0.7, 1000.0, corner)
    known = np.isfinite(found)
    assert np.count_nonzero(~known) <= 4.0 * 1000.0 / corner + 2
    # white noise above twice the corner is in it, too: a third of what is below
    assert np.sqrt(np.mean((found - true)[known] ** 2)) < 2.5 * drift + 2e-3 * 5e-3


def test_gaps_stay_and_what_drifts_is_refused() -> None:
    t = times(60.0)
    signal = np.sin(TAU * 5.0 * t)
    signal[30_000:30_010] = np.nan
    pair, lines = integrated(Signals(1000.0, signal, signal, ("m", "m/s^2")), 1.0)
    assert np.isnan(pair.response[28_500:31_500]).all()
    assert pair.units == ("m", "m")
    np.testing.assert_allclose(pair.response[5000:20_000], -signal[5000:20_000] / (TAU * 5.0) ** 2, atol=1e-5)
    assert "whole from 2 Hz on; drift" in lines[0]
    with pytest.raises(AnalysisError, match="too low in frequency for the noise"):
        displacement_of(0.01 * np.sin(TAU * 0.4 * t) + noise(t.size, 1, 1.0), 1000.0, 0.3)
    with pytest.raises(AnalysisError, match="no part without a gap has 60 s"):
        displacement_of(signal, 1000.0, 0.1)
    with pytest.raises(AnalysisError, match="given channels in m and m; allowed: one in m/s"):
        integrated(Signals(1000.0, signal, signal), 1.0)
