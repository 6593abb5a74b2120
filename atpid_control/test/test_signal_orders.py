# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Orders of a response against closed forms, and what they say of motions that have none."""

import math
import sys

import numpy as np
import pytest
from made_signals import RATE, noise, tone

from atpid_control.analysis import Signals, orders
from atpid_control.analysis.orders import steady_part, tone_of


def test_orders_have_their_amplitudes_and_phases_and_the_distortion() -> None:
    frequency, given = 5.4321, {1: (0.1, 0.5), 2: (0.01, -1.0), 3: (0.02, 2.0)}
    support = tone(frequency, 0.02, 6.0, 0.7)
    beam = sum((tone(k * frequency, a, 6.0, p + 0.7 * k) for k, (a, p) in given.items()), np.full(6000, -0.3))
    beam[100:400] = np.nan  # lost
    found = orders(Signals(RATE, support, beam), 4)
    assert found.frequency == pytest.approx(frequency, rel=1e-6)
    assert found.excitation == pytest.approx(0.02, rel=1e-6)
    np.testing.assert_allclose(found.amplitude[:3], [0.1, 0.01, 0.02], rtol=1e-4)
    np.testing.assert_allclose(found.phase[:3], [0.5, -1.0, 2.0], atol=1e-3)
    assert found.amplitude[3] < 1e-5
    assert found.distortion == pytest.approx(math.hypot(0.01, 0.02) / 0.1, rel=1e-4)
    assert found.doubts == ()


def test_irregular_motion_and_a_changing_amplitude_are_doubted() -> None:
    support = tone(5.0, 0.02, 6.0)
    half = orders(Signals(RATE, support, tone(5.0, 0.1, 6.0) + tone(2.5, 0.05, 6.0)))
    assert any("irregular or subharmonic" in line for line in half.doubts)
    growing = orders(Signals(RATE, support, tone(5.0, 0.1, 6.0) * np.linspace(0.5, 1.0, 6000)))
    assert any("the amplitude changes by" in line for line in growing.doubts)


def test_the_last_constant_part_is_taken() -> None:
    support = np.concatenate([tone(5.0, 0.02, 6.0), tone(5.0, 0.04, 6.0), np.zeros(2000)])
    part = steady_part(Signals(RATE, support, support))
    assert 8.5 < part.start < 9.5
    assert 11.0 < part.start + part.duration <= 12.01
    assert tone_of(support, RATE) == pytest.approx(5.0, abs=0.05)


def test_a_square_wave_has_odd_orders_that_fall_as_one_over_k() -> None:
    """Fourier: 4/(pi k) for odd k; with samples beside the edges exact to (pi k f/rate)^2/6."""
    frequency = 5.0
    support = tone(frequency, 0.02, 20.0, math.pi * frequency / RATE)
    found = orders(Signals(RATE, support, np.sign(support)), 9)
    exact = [4.0 / (math.pi * k) if k % 2 else 0.0 for k in range(1, 10)]
    np.testing.assert_allclose(found.amplitude, exact, rtol=4e-3, atol=1e-9)
    np.testing.assert_allclose(found.phase[::2], 0.0, atol=1e-6)
    assert found.distortion == pytest.approx(math.sqrt(sum(1.0 / k**2 for k in (3, 5, 7, 9))), rel=4e-3)


@pytest.mark.slow
def test_an_error_bar_is_what_an_amplitude_scatters_by() -> None:
    support, beam = tone(5.0, 0.02, 10.0), tone(5.0, 0.1, 10.0) + tone(10.0, 0.01, 10.0)
    made = [orders(Signals(RATE, support, beam + noise(10_000, seed, 0.02)), 2) for seed in range(40)]
    off = np.array([(one.amplitude - [0.1, 0.01]) / one.amplitude_std for one in made])
    assert off.std() == pytest.approx(1.0, abs=0.25)
    assert abs(off.mean()) < 0.4


@pytest.mark.parametrize(("last", "named"), [(5.0, False), (5.002, False), (5.05, True), (8.0, True)])
def test_an_excitation_that_drifts_in_frequency_is_named(last: float, named: bool) -> None:
    time = np.arange(20_000) / RATE
    turns = 5.0 * time + 0.5 * (last - 5.0) * time**2 / time[-1]
    support = 0.02 * np.sin(2.0 * math.pi * turns)
    found = orders(Signals(RATE, support, 5.0 * support))
    assert any("the excitation's frequency changes from" in line for line in found.doubts) == named
    if not named:
        assert found.amplitude[0] == pytest.approx(0.1, rel=2e-3)


def test_a_long_record_is_fitted_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    signals = Signals(RATE, tone(5.0, 0.02, 6.0), tone(5.0, 0.1, 6.0, 0.4) + noise(6000, 1, 0.01))
    whole = orders(signals)
    monkeypatch.setattr(sys.modules["atpid_control.analysis.orders"], "_PIECE", 700)
    np.testing.assert_allclose(orders(signals).amplitude, whole.amplitude, rtol=1e-6)
    assert orders(signals).residual == pytest.approx(whole.residual, rel=1e-9)
