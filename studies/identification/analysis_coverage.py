# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals of orders and frequency response hold the truth, and when friction is named.

The signals are made here; `python -m studies.identification.analysis_coverage` prints the table.
"""

import math
import sys

import numpy as np
from scipy.signal import lfilter

from atpid_control.analysis import Signals, free_decay, frequency_response, orders
from atpid_sim.system import Array

RATE, TAU = 1000.0, 2.0 * math.pi
#: Half a 95 % interval in standard deviations; samples after which noise has forgotten its start.
WIDTH, _BEFORE = 1.959964, 2000
#: Memories of the noise from sample to sample.
MEMORIES = (0.0, 0.9, 0.99)


def noise(rng: np.random.Generator, count: int, memory: float, level: float) -> Array:
    """Return stationary first-order autoregressive noise (count,) of standard deviation `level`."""
    drive = rng.normal(0.0, level * math.sqrt(1.0 - memory**2), count + _BEFORE)
    return np.asarray(lfilter([1.0], [1.0, -memory], drive)[_BEFORE:])


def orders_held(memory: float, seconds: float, signals: int, seed: int) -> float:
    """Return the share of three orders' intervals that hold their amplitudes under noise of 1 % of the first [-]."""
    rng, t, amplitudes = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE, (0.1, 0.02, 0.01)
    off = []
    for _ in range(signals):
        turns = TAU * rng.uniform(5.0, 6.0) * t
        support = 0.02 * np.sin(turns + rng.uniform(0.0, TAU)) + noise(rng, t.size, 0.0, 2e-5)
        beam = noise(rng, t.size, memory, 1e-3)
        for k, amplitude in enumerate(amplitudes, 1):
            beam = beam + amplitude * np.sin(k * turns + rng.uniform(0.0, TAU))
        found = orders(Signals(RATE, support, beam), len(amplitudes))
        off.append((found.amplitude - amplitudes) / found.amplitude_std)
    return float(np.mean(np.abs(off) <= WIDTH))


def response_held(memory: float, at_input: bool, seconds: float, signals: int, seed: int) -> tuple[float, float]:
    """Return the shares of intervals that hold size and phase of a resonance's response, 3 to 60 Hz in 1 Hz [-].

    The noise is at the output, for H1, or `at_input`, for H2.
    """
    rng, damping, natural = np.random.default_rng(seed), 0.15, TAU * 20.0 / RATE
    radius, angle = math.exp(-damping * natural), natural * math.sqrt(1.0 - damping**2)
    poles = [1.0, -2.0 * radius * math.cos(angle), radius**2]
    size, phase = [], []
    for _ in range(signals):
        count = round(seconds * RATE)
        whole = rng.normal(0.0, 1.0, count + _BEFORE)
        given, answer = whole[_BEFORE:], lfilter([sum(poles)], poles, whole)[_BEFORE:]
        spoil = noise(rng, count, memory, 0.2 if at_input else 0.1)
        pair = (given + spoil, answer) if at_input else (given, answer + spoil)
        found = frequency_response(Signals(RATE, *pair), 1.0)
        lines = (found.frequency >= 3.0) & (found.frequency <= 60.0)
        delay = np.exp(-1j * TAU * found.frequency[lines] / RATE)
        ratio = (found.h2 if at_input else found.h1)[lines] * np.polyval(poles[::-1], delay) / sum(poles)
        size.append((1.0 - 1.0 / np.abs(ratio)) / found.relative_std[lines])
        phase.append(np.angle(ratio) / found.relative_std[lines])
    return tuple(float(np.mean(np.abs(values) <= WIDTH)) for values in (size, phase))  # type: ignore[return-value]


def friction_named(share: float, memory: float, signals: int, seed: int) -> float:
    """Return the share of decays of 6 s from 0.1 m, in noise of 0.5 mm, whose damping is said to depend on amplitude.

    share: of friction, which takes as much a second from any swing as viscous damping from this share of the first.
    """
    rng, t, damping, omega = np.random.default_rng(seed), np.arange(6000) / RATE, 0.0237, TAU * 5.5
    fall, friction, named = damping * omega, share * 0.1, 0
    envelope = np.maximum(0.0, (0.1 + friction) * np.exp(-fall * t) - friction)
    for _ in range(signals):
        swing = envelope * np.cos(omega * math.sqrt(1.0 - damping**2) * t + rng.uniform(0.0, TAU))
        found = free_decay(swing + 0.2 + noise(rng, t.size, memory, 5e-4), RATE)
        named += any("damping depends on the amplitude" in line for line in found.doubts)
    return named / signals


def main(signals: int = 100, seed: int = 1) -> None:
    """Print the table."""
    print(f"| {signals} signals a figure, seed {seed} | white | AR(0.9) | AR(0.99) |\n|---|---|---|---|")
    for seconds in (1.2, 6.0):
        _row(f"orders 1 to 3, {seconds:g} s", [orders_held(one, seconds, signals, seed) for one in MEMORIES])
    for seconds in (20.0, 60.0):
        output = [response_held(one, False, seconds, signals, seed) for one in MEMORIES]
        given = [response_held(one, True, seconds, signals, seed) for one in MEMORIES]
        for place, name in enumerate(("size", "phase")):
            _row(f"{name} of H1, noise at the output, {seconds:g} s", [one[place] for one in output])
            _row(f"{name} of H2, noise at the input, {seconds:g} s", [one[place] for one in given])
    for share in (0.0, 0.005, 0.05):
        _row(f"friction of {100 * share:g} % is named", [friction_named(share, m, signals, seed) for m in MEMORIES])


def _row(name: str, shares: list[float]) -> None:
    print(f"| {name} | " + " | ".join(f"{100.0 * share:.1f} %" for share in shares) + " |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
