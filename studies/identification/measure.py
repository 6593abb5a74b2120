# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The measurements behind the pictures and tables of docs/identification.md; seeds are fixed."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from atpid_control.analysis.signals import Signals
from atpid_control.identification import Estimate, Identifier, Settings
from atpid_control.identification.from_beam import ModelInverse
from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.window import seed_frequency
from atpid_control.loop.rumble import RumbleSettings, RumbleWatch
from atpid_lab.beam.fit import fit_beam
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array
from studies.identification.baselines import cramer_rao, fft_bin, hann_parabola, jacobsen, plain_sine_fit

#: The values of config/identifier.yaml.
SETTINGS = Settings()
RUMBLE = RumbleSettings()
RATE, BLOCK, FREQUENCY, AMPLITUDE = 1000.0, 50, 5.49, 0.015
STEP_AT, CLOSED_AMPLITUDE = 2.03, 0.01
TAU = 2.0 * math.pi
#: The standard bench, closed, and the excitation of thesis section 4.3.
_CLOSED: dict[str, object] = {
    "excitation": {"amplitude": CLOSED_AMPLITUDE, "frequency": "resonance"}, "ceiling": {"height": 0.017},
    "duration": 12.0, "steady_window": [10.0, 12.0],
}  # fmt: skip
RAMPS = ((0.0, 0.0), (0.5, 0.015), (6.0, 0.015), (8.0, 0.04), (13.0, 0.04), (14.0, 0.03), (20.0, 0.03))


def bench(**changes: object) -> Scene:
    """Return the standard bench, closed, with some keys changed."""
    return standard_bench(**{**_CLOSED, **changes})


def noise_of(decibels: float, amplitude: float = AMPLITUDE) -> float:
    """Return the standard deviation [m] of noise `decibels` of power below a tone of `amplitude` [m]."""
    return amplitude * math.sqrt(0.5) * math.exp(-decibels / 20.0 * math.log(10.0))


def estimates(
    support: Array | None, beam: Array | None = None, inverse: ModelInverse | None = None, height: float = math.nan
) -> list[Estimate]:
    """Push signals (n,) [m] block by block and return all estimates."""
    identifier, found = Identifier(SETTINGS, inverse), []
    size = support.size if support is not None else 0 if beam is None else beam.size
    for first in range(0, size, BLOCK):
        part = slice(first, first + BLOCK)
        found.append(
            identifier.push(
                first, RATE, None if support is None else support[part], None if beam is None else beam[part],
                (first + BLOCK - 1) / RATE, height=height,
            )
        )  # fmt: skip
    return found


def errors_over_window(decibels: float, trials: int = 400) -> tuple[Array, dict[str, Array]]:
    """Return window lengths [periods] and relative rms errors of the amplitude, method by method, beside the bound."""
    periods = np.array([1.0, 1.15, 1.3, 1.5, 1.7, 1.85, 2.0, 2.2, 2.5, 2.75, 3.0, 3.25, 3.5, 3.75, 4.0])
    rng, sigma = np.random.default_rng(int(decibels)), noise_of(decibels)
    names = ("FFT bin (thesis)", "FFT, interpolated (Candan)", "Hann, padded, parabola", "four-parameter sine fit")
    errors = {name: np.empty(periods.size) for name in (*names, "Cramér-Rao bound")}
    for column, length in enumerate(periods):
        samples = math.ceil(length * RATE / FREQUENCY)
        tau = (np.arange(samples) - (samples - 1)) / RATE
        middle = tau - tau.mean()
        squares = np.zeros(5)
        for phase in rng.uniform(-math.pi, math.pi, trials):
            u = AMPLITUDE * np.sin(TAU * FREQUENCY * middle + phase) + 0.02 + rng.normal(0.0, sigma, samples)
            fit = fit_sine(tau, u, TAU * seed_frequency(u, RATE, 1.0, 40.0), TAU * 50.0, 20.0)
            guesses = (fft_bin(u), jacobsen(u), hann_parabola(u), math.nan if fit is None else fit.amplitude)
            squares[:4] += (np.array(guesses) / AMPLITUDE - 1.0) ** 2
            squares[4] += (cramer_rao(AMPLITUDE, FREQUENCY, phase, samples, RATE, sigma).amplitude / AMPLITUDE) ** 2
        for row, name in enumerate(errors):
            errors[name][column] = math.sqrt(squares[row] / trials)
    return periods, errors


def thesis_ramps() -> tuple[tuple[Array, Array], list[Estimate]]:
    """Return the true amplitude (t, A) of thesis section 4.3 and the estimates at 40 dB of the smallest stage."""
    t = np.arange(20_000) / RATE
    amplitude = np.interp(t, [at for at, _ in RAMPS], [level for _, level in RAMPS])
    u = amplitude * np.sin(TAU * FREQUENCY * t) + np.random.default_rng(1).normal(0.0, noise_of(40.0), t.size)
    return (t, amplitude), estimates(u)


def one_step() -> tuple[tuple[Array, Array], list[Estimate]]:
    """Return the same for one step from 0.015 to 0.03 m."""
    t = np.arange(4000) / RATE
    amplitude = np.where(t < STEP_AT, 0.015, 0.03)
    u = amplitude * np.sin(TAU * FREQUENCY * t) + np.random.default_rng(2).normal(0.0, noise_of(40.0), t.size)
    return (t, amplitude), estimates(u)


Spoil = Callable[[np.random.Generator, Array, Array], Array]


def _impacts(_rng: np.random.Generator, t: Array, u: Array) -> Array:
    spoiled = u.copy()
    for first in range(40, t.size - 4, 91):
        spoiled[first : first + 4] += 0.5 * AMPLITUDE * np.array([1.0, -0.6, 0.3, -0.1])
    return spoiled


SPOILS: dict[str, Spoil] = {
    "nothing but noise": lambda _rng, _t, u: u,
    "50 Hz hum, half as large": lambda rng, t, u: u + 0.5 * AMPLITUDE * np.sin(TAU * 50.0 * t + rng.uniform(0.0, TAU)),
    "drift, a fifth a second": lambda _rng, t, u: u + 0.2 * AMPLITUDE * t,
    "harmonics, 5 % and 3 %": lambda _rng, t, u: (
        u + AMPLITUDE * (0.05 * np.sin(2 * TAU * FREQUENCY * t) + 0.03 * np.sin(3 * TAU * FREQUENCY * t + 1.0))
    ),
    "spikes, 1 % of the samples": lambda rng, t, u: (
        u + np.where(rng.random(t.size) < 0.01, rng.normal(0.0, AMPLITUDE, t.size), 0.0)
    ),
    "impacts, two a period": _impacts,
    "saturated above 0.8 A": lambda _rng, _t, u: np.clip(u, -math.inf, 0.8 * AMPLITUDE),
    "all but saturation": lambda rng, t, u: (
        _impacts(rng, t, u)
        + AMPLITUDE * (0.1 * np.sin(TAU * 50.0 * t) + 0.1 * t + 0.05 * np.sin(2 * TAU * FREQUENCY * t))
    ),
}


def spoiled_errors(trials: int = 100) -> tuple[list[str], Array, Array]:
    """Return names, and the largest relative error of the plain fit and of the identifier (n,) [-]."""
    rng, t = np.random.default_rng(3), np.arange(500) / RATE
    count = math.ceil(2.0 * RATE / FREQUENCY)
    plain, ours = np.zeros((2, len(SPOILS)))
    for row, spoil in enumerate(SPOILS.values()):
        for _ in range(trials):
            tone = AMPLITUDE * np.sin(TAU * FREQUENCY * t + rng.uniform(0.0, TAU))
            u = spoil(rng, t, tone + rng.normal(0.0, noise_of(40.0), t.size))
            fitted = plain_sine_fit(t[-count:] - t[-1], u[-count:], TAU * FREQUENCY)
            plain[row] = max(plain[row], abs(fitted / AMPLITUDE - 1.0))
            ours[row] = max(ours[row], abs(estimates(u)[-1].amplitude / AMPLITUDE - 1.0))
    return list(SPOILS), plain, ours


def from_closed_beam() -> tuple[Array, Array, list[Estimate]]:
    """Return time, the measured beam of the closed damper from rest, and the estimates of the support."""
    scene = bench()
    motion = trajectory(scene, RATE)
    size = half_peak_to_peak(motion.beam[-1000:])
    beam = motion.beam + np.random.default_rng(1).normal(0.0, noise_of(40.0, size), motion.beam.size)
    return motion.time, beam, estimates(None, beam, ModelInverse.of_scene(scene), 0.017)


@dataclass(frozen=True)
class Course:
    """One course of the bench with the state of the rumble watch."""

    time: Array
    beam: Array
    height: Array
    state_time: Array
    scatter: Array
    alarms: list[tuple[float, float]]


#: Ceiling commands (t [s], h [m]) along the ramps: a little below the best heights, and above them.
COURSES = {
    "ceiling below the best heights": ((1.0, 0.28), (8.0, 0.74), (13.1, 0.55)),
    "ceiling 15 % above them": ((1.0, 0.33), (8.0, 0.85), (13.1, 0.65)),
}


def watched_courses() -> dict[str, Course]:
    """Return the courses of the bench under thesis section 4.3, at 40 dB of the smallest response."""
    excitation = {"amplitude": list(map(list, RAMPS)), "frequency": "resonance"}
    scene = bench(duration=20.0, steady_window=[18.0, 20.0], excitation=excitation)
    return {name: _watched(scene, commands) for name, commands in COURSES.items()}


def _watched(scene: Scene, commands: tuple[tuple[float, float], ...]) -> Course:
    plant, watch, rng = Plant(scene), RumbleWatch(RUMBLE), np.random.default_rng(5)
    blocks, scatter, seen = [], [], []
    for first in range(0, 20_000, BLOCK):
        height = [0.017, *(h for t, h in commands if t <= first / RATE)][-1]
        block = plant.advance(BLOCK, RATE, height, 0.3)
        noisy = block.beam + rng.normal(0.0, noise_of(40.0, 0.07), BLOCK)
        state = watch.push(first, RATE, noisy, scene.frequency_hz)
        blocks.append((noisy, block.ceiling))
        scatter.append(state.scatter)
        seen.append(state.rumbling)
    beam, ceiling = (np.concatenate(series) for series in zip(*blocks, strict=True))
    time = np.arange(1, len(seen) + 1) * BLOCK / RATE
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.array(seen, dtype=int), [0]))))
    alarms = [(float(time[begin]), float(time[min(end, time.size - 1)])) for begin, end in edges.reshape(-1, 2)]
    return Course(np.arange(beam.size) / RATE, beam, ceiling, time, np.array(scatter), alarms)


@dataclass(frozen=True)
class Calibrations:
    """Relative errors of stiffness and damping (n, 2) over the lasers' noise (n,) [m], and the error bars claimed."""

    noise: Array
    error: Array
    claimed: Array


def calibrations(trials: int = 10) -> dict[str, Calibrations]:
    """Return the errors of calibrations by a decay and a sweep of the closed damper."""
    decay = bench(excitation={"free": {"deflection": 0.1}}, duration=10.0, steady_window=[0.0, 10.0])
    swept = {"sweep": {"amplitude": 0.002, "from": 4.0, "to": 7.0}}
    sweep = bench(excitation=swept, duration=20.0, steady_window=[0.0, 20.0])
    return {
        "decay from 0.1 m, 10 s": _calibrated(decay, trials),
        "sweep 4 to 7 Hz, 2 mm, 20 s": _calibrated(sweep, trials),
    }


def _calibrated(scene: Scene, trials: int) -> Calibrations:
    motion, rng = trajectory(scene, RATE), np.random.default_rng(7)
    noise, mass = np.array([2e-5, 1e-4, 5e-4]), scene.total_mass
    truth = np.array([scene.beam.stiffness, scene.beam.damping]) / mass
    error, claimed = np.empty((2, noise.size, 2))
    for row, sigma in enumerate(noise):
        found, bars = np.empty((2, trials, 2))
        for k in range(trials):
            beam, support = (x + rng.normal(0.0, sigma, x.size) for x in (motion.beam, motion.support))
            fit = fit_beam(Signals(RATE, support, beam))
            found[k] = fit.stiffness, fit.damping
            bars[k] = np.sqrt(np.diag(fit.covariance))
        error[row] = np.sqrt(np.mean((found / truth - 1.0) ** 2, axis=0))
        claimed[row] = np.mean(bars / truth, axis=0)
    return Calibrations(noise, error, claimed)
