# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Against the Cramér-Rao bound: nothing is left to gain for a tone in white noise."""

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY, RATE

from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.window import seed_frequency
from studies.identification.baselines import cramer_rao, fft_bin, fisher_information, hann_parabola, jacobsen

TRIALS = 1500


def _ratio(samples: int, decibels: float, seed: int) -> dict[str, float]:
    """Root mean square errors over `TRIALS` random phases, as multiples of the bound's."""
    rng, sigma = np.random.default_rng(seed), AMPLITUDE / np.sqrt(2.0) * 10.0 ** (-decibels / 20.0)
    tau = (np.arange(samples) - (samples - 1)) / RATE
    errors, bounds = np.empty((TRIALS, 2)), np.empty((TRIALS, 2))
    for k, phase in enumerate(rng.uniform(-np.pi, np.pi, TRIALS)):
        middle = tau - tau.mean()
        u = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * middle + phase) + 0.02 + rng.normal(0.0, sigma, samples)
        fit = fit_sine(tau, u, 2 * np.pi * seed_frequency(u, RATE, 1.0, 40.0), 2 * np.pi * 50.0, 20.0)
        assert fit is not None
        assert fit.change == 0.0
        errors[k] = fit.amplitude - AMPLITUDE, fit.omega / (2 * np.pi) - FREQUENCY
        bound = cramer_rao(AMPLITUDE, FREQUENCY, float(phase), samples, RATE, sigma)
        bounds[k] = bound.amplitude, bound.frequency
    ratio = np.sqrt((errors**2).mean(axis=0) / (bounds**2).mean(axis=0))
    return {"amplitude": float(ratio[0]), "frequency": float(ratio[1])}


@pytest.mark.slow
@pytest.mark.parametrize("decibels", [20.0, 40.0, 60.0])
@pytest.mark.parametrize("periods", [1.0, 1.25, 1.5, 2.0, 3.0])
def test_from_one_period_on_the_error_is_the_bound(periods: float, decibels: float) -> None:
    ratio = _ratio(int(np.ceil(periods * RATE / FREQUENCY)), decibels, seed=int(10 * periods + decibels))
    assert ratio["amplitude"] <= 1.1
    assert ratio["frequency"] <= 1.1


def test_the_closed_form_is_the_sum_over_samples() -> None:
    for samples, omega, phase in ((183, 0.0345, 0.7), (365, 0.0345, -2.0), (40, 0.9, 3.0)):
        n = np.arange(samples) - 0.5 * (samples - 1)
        a, b = np.sin(phase), np.cos(phase)
        c, s = np.cos(omega * n), np.sin(omega * n)
        slopes = np.stack([c, s, np.ones(samples), n * (b * c - a * s)])
        np.testing.assert_allclose(fisher_information(a, b, omega, samples), slopes @ slopes.T, atol=1e-9, rtol=1e-9)


def test_the_bound_for_many_periods_is_the_textbook_s() -> None:
    samples, sigma = 20_000, 1e-3
    bound = cramer_rao(1.0, 50.0, 0.3, samples, 1000.0, sigma)
    assert bound.amplitude == pytest.approx(sigma * np.sqrt(2.0 / samples), rel=1e-3)
    textbook = np.sqrt(24.0 / samples**3) * sigma / (2.0 * np.pi) * 1000.0
    assert bound.frequency == pytest.approx(textbook, rel=1e-3)


@pytest.mark.parametrize("method", [fft_bin, jacobsen, hann_parabola])
def test_the_classic_methods_are_right_where_they_may_be(method: object) -> None:
    n = np.arange(1000)
    u = 0.5 * np.sin(2 * np.pi * 20.0 * n / 1000.0 + 0.4) + 3.0
    assert method(u) == pytest.approx(0.5, rel=1e-3)  # type: ignore[operator]
