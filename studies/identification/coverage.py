# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How often 95 % intervals hold the truth, by Monte-Carlo: signals made here, of numpy alone.

The identifier sees the signals only; frequency, amplitude, phase and offset are drawn anew for each.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from atpid_common.vocabulary import Quality
from atpid_control.identification import Identifier
from atpid_sim.system import Array
from studies.identification.measure import SETTINGS

#: Samples a second and in each signal, and those of the last block.
RATE, SAMPLES, BLOCK = 1000.0, 1200, 50
#: Standard deviations on either side of a 95 % interval.
Z95 = 1.959964
TAU = 2.0 * math.pi


@dataclass(frozen=True)
class Truth:
    """A tone: amplitude [m], frequency [Hz], phase at the first sample [rad]."""

    amplitude: float
    frequency: float
    phase: float

    def at(self, time: Array) -> Array:
        """Return the tone at `time` (n,) [s]."""
        return np.asarray(self.amplitude * np.sin(TAU * self.frequency * time + self.phase))


Make = Callable[[np.random.Generator, Array, Truth], Array]


def red(rng: np.random.Generator, count: int, memory: float, sigma: float) -> Array:
    """Return stationary noise (n,) of standard deviation `sigma` in which each value keeps `memory` of the last."""
    fresh = rng.normal(0.0, sigma * math.sqrt(1.0 - memory**2), count)
    fresh[0] = rng.normal(0.0, sigma)
    for place in range(1, count):
        fresh[place] += memory * fresh[place - 1]
    return fresh


def _coloured(memory: float, share: float, white: float = 0.0) -> Make:
    def make(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
        noise = red(rng, t.size, memory, share * tone.amplitude) + rng.normal(0.0, white * tone.amplitude, t.size)
        return np.asarray(tone.at(t) + noise)

    return make


def _white(rng: np.random.Generator, tone: Truth, share: float, count: int) -> Array:
    return rng.normal(0.0, share * tone.amplitude, count)


def _quantised(parts: float, share: float = 0.0) -> Make:
    def make(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
        step = tone.amplitude / parts
        return np.asarray(step * np.round((tone.at(t) + _white(rng, tone, share, t.size)) / step))

    return make


def _clipped(level: float, share: float, noise_first: bool, below: bool = True) -> Make:
    def make(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
        noise, top = _white(rng, tone, share, t.size), level * tone.amplitude
        bottom = -top if below else -math.inf
        if noise_first:
            return np.clip(tone.at(t) + noise, bottom, top)
        return np.asarray(np.clip(tone.at(t), bottom, top) + noise)

    return make


def _with(share: float, *others: tuple[float, float], hertz: tuple[float, float] | None = None) -> Make:
    """Return a tone in white noise with others at (multiple of its frequency, share), or one of (hertz, share)."""

    def make(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
        found = tone.at(t) + _white(rng, tone, share, t.size)
        for multiple, size in others:
            other = Truth(size * tone.amplitude, multiple * tone.frequency, rng.uniform(0.0, TAU))
            found = found + other.at(t)
        if hertz is not None:
            found = found + Truth(hertz[1] * tone.amplitude, hertz[0], rng.uniform(0.0, TAU)).at(t)
        return np.asarray(found)

    return make


def _missing(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
    found = tone.at(t) + _white(rng, tone, 0.01, t.size)
    for first in rng.integers(0, t.size - 20, 6):
        found[first : first + 20] = np.nan
    return found


def _spiked(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
    spikes = np.where(rng.random(t.size) < 0.01, rng.normal(0.0, tone.amplitude, t.size), 0.0)
    return np.asarray(tone.at(t) + _white(rng, tone, 0.01, t.size) + spikes)


def _sloped(rng: np.random.Generator, t: Array, tone: Truth) -> Array:
    return np.asarray(tone.at(t) + _white(rng, tone, 0.01, t.size) + 0.2 * tone.amplitude * t)


#: What the signals hold besides the tone; percentages are of its amplitude.
CASES: dict[str, Make] = {
    "white noise, 0.1 %": _coloured(0.0, 0.001),
    "white noise, 1 %": _coloured(0.0, 0.01),
    "white noise, 10 %": _coloured(0.0, 0.1),
    "AR(0.5), 1 %": _coloured(0.5, 0.01),
    "AR(0.9), 0.1 %": _coloured(0.9, 0.001),
    "AR(0.9), 1 %": _coloured(0.9, 0.01),
    "AR(0.99), 1 %": _coloured(0.99, 0.01),
    "AR(0.99), 0.5 %, and white, 0.5 %": _coloured(0.99, 0.005, 0.005),
    "quantised, A/15": _quantised(15.0),
    "quantised, A/50": _quantised(50.0),
    "quantised, A/150": _quantised(150.0),
    "quantised, A/1000": _quantised(1000.0),
    "quantised, A/50, noise 1 %": _quantised(50.0, 0.01),
    "baseline 0.3 Hz, 0.2 A": _with(0.01, hertz=(0.3, 0.2)),
    "drift, 0.2 A a second": _sloped,
    "clipped at 0.9 A, then noise 0.3 %": _clipped(0.9, 0.003, False),
    "clipped above 0.9 A, then noise 0.3 %": _clipped(0.9, 0.003, False, below=False),
    "clipped at 0.95 A, then noise 0.3 %": _clipped(0.95, 0.003, False),
    "noise 0.3 %, then clipped at 0.9 A": _clipped(0.9, 0.003, True),
    "subharmonic, 5 %": _with(0.01, (0.5, 0.05)),
    "harmonics, 5 and 3 %": _with(0.01, (2.0, 0.05), (3.0, 0.03)),
    "hum of 50 Hz, 20 %": _with(0.01, hertz=(50.0, 0.2)),
    "blocks of 20 missing": _missing,
    "spikes, 1 % of the samples": _spiked,
}  # fmt: skip


@dataclass(frozen=True)
class Coverage:
    """How many of a number of signals were called steady, and in how many of these the interval holds the truth."""

    signals: int
    steady: int
    amplitude: int
    frequency: int
    phase: int
    spread: float  # root mean square of the amplitude's error over its standard deviation [-]


def coverage(name: str, signals: int, seed: int) -> Coverage:
    """Return the coverage of one of `CASES` over `signals` signals of random tones."""
    rng = np.random.default_rng([seed, *name.encode()])
    t = np.arange(SAMPLES) / RATE
    held, steady, ratios = np.zeros(3, dtype=int), 0, []
    for _ in range(signals):
        tone = Truth(rng.uniform(0.005, 0.05), rng.uniform(4.0, 9.0), rng.uniform(0.0, TAU))
        u = CASES[name](rng, t, tone) + rng.uniform(-0.02, 0.02)
        identifier = Identifier(SETTINGS)
        for first, last in ((0, SAMPLES - BLOCK), (SAMPLES - BLOCK, SAMPLES)):
            found = identifier.push(first, RATE, u[first:last], None, t[last - 1])
        if found.quality != Quality.STEADY:
            continue
        steady += 1
        phase = TAU * tone.frequency * t[-1] + tone.phase
        ratio = np.array([
            (found.amplitude - tone.amplitude) / found.amplitude_std,
            (found.frequency - tone.frequency) / found.frequency_std,
            math.remainder(found.phase - phase, TAU) / found.phase_std,
        ])  # fmt: skip
        held += np.abs(ratio) <= Z95
        ratios.append(ratio[0])
    spread = float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
    return Coverage(signals, steady, int(held[0]), int(held[1]), int(held[2]), spread)


def table(signals: int, seed: int, count: Callable[[int], object] | None = None) -> list[str]:
    """Return the lines of the page's table; `count` is told how many kinds are done."""
    lines = [
        f"Tones of each kind: {signals}, seed {seed}; shares of the steady whose 95 % interval holds the truth.",
        "",
        "| besides the tone | steady | amplitude | frequency | phase |",
        "|---|---|---|---|---|",
    ]
    for done, name in enumerate(CASES, 1):
        one = coverage(name, signals, seed)
        held = (one.amplitude, one.frequency, one.phase)
        shares = [f"{100.0 * number / one.steady:.1f} %" if one.steady else "-" for number in held]
        lines.append(f"| {name} | {one.steady} | {' | '.join(shares)} |")
        if count is not None:
            count(done)
    return lines
