# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Error bars of the identifier and of recorded signals hold the truth; a tone's error is the Cramér-Rao bound."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from identification_signals import AMPLITUDE, FREQUENCY
from identification_signals import RATE as SAMPLED
from made_signals import RATE, noise, tone
from scipy.signal import lfilter

from atpid_common.vocabulary import Quality
from atpid_control.analysis import AnalysisError, Signals, analyse, frequency_response, orders
from atpid_control.analysis.frequency_response import passes_once
from atpid_control.identification import Identifier
from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.window import seed_frequency
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array
from studies.identification import measure as showcase
from studies.identification.baselines import cramer_rao
from studies.identification.measure import SETTINGS

#: Samples of each tone and of its last block.
SAMPLES, BLOCK = 1200, 50
#: Half a 95 % interval in standard deviations; samples after which noise has forgotten its start.
WIDTH, BEFORE, TAU = 1.959964, 2000, 2.0 * math.pi
Random = np.random.Generator


def red(random: Random, count: int, memory: float, level: float) -> Array:
    """Return stationary first-order autoregressive noise (count,) of standard deviation `level`."""
    drive = random.normal(0.0, level * math.sqrt(1.0 - memory**2), count + BEFORE)
    return np.asarray(lfilter([1.0], [1.0, -memory], drive)[BEFORE:])


def missing(random: Random, u: Array) -> Array:
    for first in random.integers(0, u.size - 20, 6):
        u[first : first + 20] = np.nan
    return u


#: What becomes of a tone u of amplitude 1 at times t [s], and the noise over it.
CASES: dict[str, tuple[Callable[[Random, Array, Array], Any], float]] = {
    "white noise, 1 %": (lambda _r, _t, u: u, 0.01),
    "AR(0.9), 1 %": (lambda r, _t, u: u + red(r, u.size, 0.9, 0.01), 0.0),
    "AR(0.99), 1 %": (lambda r, _t, u: u + red(r, u.size, 0.99, 0.01), 0.0),
    "quantised, A/50": (lambda _r, _t, u: np.round(50.0 * u) / 50.0, 0.0),
    "baseline 0.3 Hz, 0.2 A": (lambda r, t, u: u + 0.2 * np.sin(TAU * 0.3 * t + r.uniform(0.0, TAU)), 0.01),
    "drift, 0.2 A a second": (lambda _r, t, u: u + 0.2 * t, 0.01),
    "clipped at 0.9 A": (lambda _r, _t, u: np.clip(u, -0.9, 0.9), 0.003),
    "hum of 50 Hz, 20 %": (lambda r, t, u: u + 0.2 * np.sin(TAU * 50.0 * t + r.uniform(0.0, TAU)), 0.01),
    "blocks of 20 missing": (lambda r, _t, u: missing(r, u), 0.01),
    "spikes, 1 % of the samples": (lambda r, _t, u: u + (r.random(u.size) < 0.01) * r.normal(0.0, 1.0, u.size), 0.01),
}  # fmt: skip


def held(name: str, signals: int, seed: int) -> tuple[int, int]:
    """Return how many random tones were called steady, and in how many the intervals of all three quantities hold."""
    random, t = np.random.default_rng([seed, *name.encode()]), np.arange(SAMPLES) / RATE
    make, level = CASES[name]
    counts, steady = np.zeros(3, dtype=int), 0
    for _ in range(signals):
        amplitude, frequency, phase = random.uniform(0.005, 0.05), random.uniform(4.0, 9.0), random.uniform(0.0, TAU)
        u = make(random, t, np.sin(TAU * frequency * t + phase)) + random.normal(0.0, level, SAMPLES)
        u, identifier = amplitude * u + random.uniform(-0.02, 0.02), Identifier(SETTINGS)
        for first, last in ((0, SAMPLES - BLOCK), (SAMPLES - BLOCK, SAMPLES)):
            found = identifier.push(first, RATE, u[first:last], None, t[last - 1])
        if found.quality == Quality.STEADY:
            steady += 1
            off = math.remainder(found.phase - TAU * frequency * t[-1] - phase, TAU) / found.phase_std
            off_amplitude = (found.amplitude - amplitude) / found.amplitude_std
            counts += np.abs([off_amplitude, (found.frequency - frequency) / found.frequency_std, off]) <= WIDTH
    return steady, int(counts.min())


def orders_held(memory: float, seconds: float, signals: int, seed: int) -> float:
    """Return the share of three orders' intervals that hold their amplitudes under noise of 1 % of the first [-]."""
    random, t, amplitudes = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE, (0.1, 0.02, 0.01)
    off = []
    for _ in range(signals):
        turns = TAU * random.uniform(5.0, 6.0) * t
        support = 0.02 * np.sin(turns + random.uniform(0.0, TAU)) + red(random, t.size, 0.0, 2e-5)
        beam = red(random, t.size, memory, 1e-3)
        for k, amplitude in enumerate(amplitudes, 1):
            beam = beam + amplitude * np.sin(k * turns + random.uniform(0.0, TAU))
        found = orders(Signals(RATE, support, beam), len(amplitudes))
        off.append((found.amplitude - amplitudes) / found.amplitude_std)
    return float(np.mean(np.abs(off) <= WIDTH))


@pytest.mark.parametrize("name", sorted(CASES))
def test_bars_hold_or_the_estimate_is_not_steady(name: str) -> None:
    steady, least = held(name, 80, 31)
    if steady > 3:
        assert least >= steady * 0.93 - 3.5 * math.sqrt(steady * 0.93 * 0.07)


TRIALS = 600


def error_ratios(samples: int, decibels: float, seed: int) -> Array:
    """Root mean square errors of amplitude and frequency over `TRIALS` random phases, as multiples of the bound's."""
    rng, sigma = np.random.default_rng(seed), AMPLITUDE / np.sqrt(2.0) * 10.0 ** (-decibels / 20.0)
    tau = (np.arange(samples) - (samples - 1)) / SAMPLED
    errors, bounds = np.empty((TRIALS, 2)), np.empty((TRIALS, 2))
    for k, phase in enumerate(rng.uniform(-np.pi, np.pi, TRIALS)):
        middle = tau - tau.mean()
        u = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * middle + phase) + 0.02 + rng.normal(0.0, sigma, samples)
        fit = fit_sine(tau, u, 2 * np.pi * seed_frequency(u, SAMPLED, 1.0, 40.0), 2 * np.pi * 50.0, 20.0)
        assert fit is not None
        assert fit.change == 0.0
        errors[k] = fit.amplitude - AMPLITUDE, fit.omega / (2 * np.pi) - FREQUENCY
        bound = cramer_rao(AMPLITUDE, FREQUENCY, float(phase), samples, SAMPLED, sigma)
        bounds[k] = bound.amplitude, bound.frequency
    ratio: Array = np.sqrt((errors**2).mean(axis=0) / (bounds**2).mean(axis=0))
    return ratio


@pytest.mark.parametrize("decibels", [20.0, 40.0, 60.0])
@pytest.mark.parametrize("periods", [1.0, 1.25, 1.5, 2.0, 3.0])
def test_from_one_period_on_the_error_is_the_bound(periods: float, decibels: float) -> None:
    ratio = error_ratios(int(np.ceil(periods * SAMPLED / FREQUENCY)), decibels, seed=int(10 * periods + decibels))
    assert ratio.max() <= 1.15  # six hundred trials scatter by 3 %


def test_spoiled_signals_stay_within_a_per_cent() -> None:
    names, plain, ours = showcase.spoiled_errors(trials=15)
    assert ours.max() < 0.01, dict(zip(names, ours, strict=True))
    assert plain.max() > 0.02


def test_the_intervals_of_orders_hold_whatever_the_noise_remembers() -> None:
    assert min(orders_held(memory, 1.2, 40, 2) for memory in (0.0, 0.99)) > 0.89


def test_a_simulated_sweep_with_the_damper_closed_has_the_closed_form() -> None:
    """Beam and grain are one mass, but for what the contacts that hold the grain yield."""
    swept = {"sweep": {"amplitude": 0.002, "from": 4.0, "to": 7.0}}
    scene = standard_bench(excitation=swept, ceiling={"height": 0.017}, duration=60.0, tolerance=1e-5)
    random = np.random.default_rng(4)
    motion = trajectory(scene, RATE)
    support, beam = (one + random.normal(0.0, 2e-5, len(one)) for one in (motion.support, motion.beam))
    found = analyse(Signals(RATE, support, beam)).response
    assert found is not None
    assert found.local is not None
    lines = found.trusted & (found.frequency > 4.2) & (found.frequency < 6.8)
    omega = 2j * math.pi * found.frequency[lines]
    off = found.h1[lines] * (scene.total_mass * omega**2 + 0.56 * omega + 427.6) / (0.56 * omega + 427.6)
    width = 1.96 * np.hypot(found.relative_std[lines], 5e-4)
    assert np.mean(np.abs(np.abs(off) - 1.0) < width) > 0.9
    assert np.mean(np.abs(np.angle(off)) < width) > 0.9


def a_sweep() -> tuple[Array, Array]:
    """Times and displacements of a minute from 4 Hz on."""
    time = np.arange(60_000) / RATE
    return time, np.sin(2.0 * math.pi * (4.0 * time + 0.02 * time**2))


def test_a_sweep_and_a_shock_pass_once_and_what_repeats_does_not() -> None:
    time, sweep = a_sweep()
    shock = np.where(time < 0.02, 1.0, 0.0) + noise(60_000, 1, 1e-4)
    steps = tone(5.0, 1.0, 60.0) * np.where(time < 30.0, 1.0, 2.0)
    assert [passes_once(one) for one in (sweep, shock)] == [True, True]
    assert [passes_once(one) for one in (steps, noise(60_000, 2), tone(5.0, 1.0, 60.0))] == [False] * 3


def test_a_gap_leaves_its_longest_part_and_is_named() -> None:
    _, sweep = a_sweep()
    sweep[9000:9100] = np.nan
    found = frequency_response(Signals(RATE, sweep, 2.0 * sweep + noise(60_000, 3, 1e-3)))
    assert any("9100" in line for line in found.doubts)
    assert np.all(np.abs(np.abs(found.h1) / 2.0 - 1.0)[found.trusted] < 5.0 * found.relative_std[found.trusted])
    with pytest.raises(AnalysisError, match="excitation"):
        frequency_response(Signals(RATE, np.zeros(60_000), sweep), window="local")
