# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test signals with everything that real ones carry, and the settings that identify them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from atpid_control.identification import Estimate, Identifier, Settings
from atpid_sim.system import Array

RATE, FREQUENCY, AMPLITUDE = 1000.0, 5.49, 0.015
PERIOD = 1.0 / FREQUENCY
SETTINGS = Settings(second_tone=0.0, slow_drift=0.0)


def times(seconds: float, rate: float = RATE) -> Array:
    """Return sampling instants (n,) [s]."""
    return np.arange(round(seconds * rate)) / rate


def tone(t: Array, amplitude: float | Array = AMPLITUDE, frequency: float = FREQUENCY, phase: float = 0.3) -> Array:
    """Return a tone (n,) [m]; `amplitude` [m] may vary."""
    return np.asarray(amplitude * np.sin(2.0 * np.pi * frequency * t + phase))


def noise(rng: np.random.Generator, size: int, decibels: float, amplitude: float = AMPLITUDE) -> Array:
    """Return white noise (n,) [m], `decibels` of power below a tone of `amplitude` [m]."""
    return rng.normal(0.0, amplitude / np.sqrt(2.0) * 10.0 ** (-decibels / 20.0), size)


def estimates(
    signal: Array, settings: Settings = SETTINGS, beam: Array | None = None, block: int = 50, rate: float = RATE
) -> list[Estimate]:
    """Push a signal block by block and return all estimates."""
    return list(_stream(Identifier(settings), signal, beam, block, rate))


def _stream(identifier: Identifier, signal: Array, beam: Array | None, block: int, rate: float) -> Iterator[Estimate]:
    for first in range(0, signal.size, block):
        part = signal[first : first + block]
        other = None if beam is None else beam[first : first + block]
        yield identifier.push(first, rate, part, other, (first + part.size - 1) / rate)


def with_(**changes: object) -> Settings:
    """Return the settings with some changed."""
    return replace(SETTINGS, **changes)  # type: ignore[arg-type]
