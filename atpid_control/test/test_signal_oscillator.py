# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The response of one mass on a driven base against its closed form: noise at input or output, and a sweep."""

import math

import numpy as np
import pytest
from made_signals import noise
from scipy.signal import chirp

from atpid_control.analysis import Signals, frequency_response
from atpid_sim.system import Array

RATE, NATURAL, DAMPING = 200.0, 5.0, 0.03
LENGTH = 400_000


def exact(frequency: Array) -> Array:
    """Return (1 + 2 i zeta r) / (1 - r^2 + 2 i zeta r), r the frequency ratio."""
    loss = 2j * DAMPING * frequency / NATURAL
    return np.asarray((1.0 + loss) / (1.0 - (frequency / NATURAL) ** 2 + loss))


def answer(support: Array) -> Array:
    """Return the periodic response to a support (n,) that is repeated for ever: exact, without a transient."""
    lines = np.fft.rfft(support) * exact(np.asarray(np.fft.rfftfreq(len(support), 1.0 / RATE), dtype=np.float64))
    return np.asarray(np.fft.irfft(lines, len(support)))


@pytest.mark.parametrize("at", ["output", "input"])
def test_the_estimator_for_the_noise_is_unbiased_and_the_other_off_by_it(at: str) -> None:
    support = noise(LENGTH, 1)
    beam, added = answer(support), noise(LENGTH, 2, 0.7)
    given, measured = (support, beam + added) if at == "output" else (support + added, beam)
    found = frequency_response(Signals(RATE, given, measured), resolution=0.02)
    inside = (found.frequency > 3.0) & (found.frequency < 7.0)
    true = np.abs(exact(found.frequency[inside]))
    right, other = (
        np.abs(h[inside]) / true for h in ((found.h1, found.h2) if at == "output" else (found.h2, found.h1))
    )
    power = 0.7**2
    # the other: noise power over that of the signal it is added to
    off = 1.0 + power / true**2 if at == "output" else np.full(len(true), 1.0 / (1.0 + power))
    assert right.mean() == pytest.approx(1.0, abs=0.01)
    assert (other / off).mean() == pytest.approx(1.0, abs=0.02)
    coherence = 1.0 / (1.0 + power / true**2) if at == "output" else np.full(len(true), 1.0 / (1.0 + power))
    np.testing.assert_allclose(found.coherence[inside].mean(), coherence.mean(), atol=0.02)


def test_a_sweep_as_one_segment_has_the_response_at_each_line() -> None:
    """From rest to rest: the whole record as one segment without a window has no leakage."""
    time = np.arange(round(80.0 * RATE)) / RATE
    support = chirp(time, 1.0, 80.0, 12.0) * np.sin(math.pi * time / 80.0)
    support = np.concatenate([support, np.zeros(round(40.0 * RATE))])
    found = frequency_response(Signals(RATE, support, answer(support)), RATE / len(support), "boxcar")
    lines = found.excited & (found.frequency < 12.0)
    assert np.count_nonzero(lines) > 1000
    np.testing.assert_allclose(found.h1[lines], exact(found.frequency[lines]), rtol=1e-9)
    assert found.frequency[found.strongest] == pytest.approx(NATURAL * math.sqrt(1.0 - 2.0 * DAMPING**2), abs=0.02)
    assert any("1 averages: coherence and error bars mean nothing" in line for line in found.doubts)
    assert math.isnan(found.relative_std[found.strongest])
