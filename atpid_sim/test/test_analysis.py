# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The analysis functions on signals whose answer is known."""

import numpy as np
import pytest

from atpid_sim import analysis
from atpid_sim.simulation import quantities

RATE = 1000.0
TIME = np.arange(4000) / RATE


def decay(ratio: float, frequency: float = 5.0) -> np.ndarray:
    """Return a decaying cosine whose successive peaks have this ratio."""
    return np.asarray(0.1 * ratio ** (-frequency * TIME) * np.cos(2.0 * np.pi * frequency * TIME))


def test_a_decay_has_one_decrement() -> None:
    # all but the first: the release is no turning point of a decaying cosine
    assert analysis.decrements(decay(1.31))[1:] == pytest.approx(1.31, rel=2e-4)


def test_a_tone_has_its_amplitude() -> None:
    tone = 0.3 + 0.02 * np.sin(2.0 * np.pi * 5.47 * TIME)
    assert analysis.amplitude_spectrum(tone, RATE)[1].max() == pytest.approx(0.02, rel=0.01)


def test_efficiency_and_amplitudes_of_periods() -> None:
    assert quantities.efficiency(0.05, 0.2) == pytest.approx(0.75)
    swelling = (1.0 + TIME) * np.sin(2.0 * np.pi * 5.0 * TIME)
    found = analysis.amplitudes_per_period(swelling, RATE / 5.0)
    assert len(found) == 20
    assert found == pytest.approx(1.1 + 0.2 * np.arange(20), rel=0.01)


def test_lag_and_offset_are_removed_and_the_error_is_that_of_the_amplitude() -> None:
    simulated = (1.0 + 0.1 * TIME) * np.sin(2.0 * np.pi * 5.0 * TIME)
    measured = 0.04 + 1.1 * np.roll(simulated, 13)
    assert analysis.lag_of(measured, simulated, 50) == 13
    one, other = analysis.aligned(measured, simulated, 13)
    assert np.mean(one) == pytest.approx(np.mean(other))
    experiment, simulation = (analysis.amplitudes_per_period(series, RATE / 5.0) for series in (one, other))
    assert analysis.relative_rmse(experiment, simulation) == pytest.approx(1.0 - 1.0 / 1.1, rel=1e-6)
