# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signals for the tests of the analysis: tones and noise."""

import math

import numpy as np

from atpid_sim.system import Array

RATE = 1000.0


def tone(frequency: float, amplitude: float, duration: float, phase: float = 0.0, rate: float = RATE) -> Array:
    time = np.arange(round(duration * rate)) / rate
    return np.asarray(amplitude * np.sin(2.0 * math.pi * frequency * time + phase))


def noise(samples: int, seed: int, deviation: float = 1.0) -> Array:
    return np.random.default_rng(seed).normal(0.0, deviation, samples)
