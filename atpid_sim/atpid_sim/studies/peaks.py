# SPDX-License-Identifier: Apache-2.0
"""Between the points of a computed motion: interpolation from displacement, velocity, acceleration; and its peaks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def between(at: Array, times: Array, x: Array, v: Array, a: Array) -> Array:
    """Return the displacement (k,) [m] at `at` (k,) [s] from x, v, a (n,) at rising `times` (n,), quintic in between.

    The error is h^6/46080 of the sixth derivative: 3e-10 of a sine with 40 points a period.
    """
    left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    h = times[left + 1] - times[left]
    s = (at - times[left]) / h
    r = 1.0 - s
    start = x[left] * (1.0 + s * (3.0 + 6.0 * s)) + h * (v[left] * s * (1.0 + 3.0 * s) + 0.5 * h * a[left] * s * s)
    end = x[left + 1] * (1.0 + r * (3.0 + 6.0 * r))
    end += h * (-v[left + 1] * r * (1.0 + 3.0 * r) + 0.5 * h * a[left + 1] * r * r)
    return np.asarray(start * r**3 + end * s**3)


def half_peak_to_peak(times: Array, x: Array, v: Array, a: Array) -> float:
    """Return half the distance [m] between the highest and the lowest displacement of the interpolated motion."""
    turning = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    low, high = times[turning].copy(), times[turning + 1].copy()
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    sign = np.where(v[turning] > 0.0, 1.0, -1.0)
    # one turning point lies in each bracket: golden section on all of them at once
    for _ in range(40):
        first, second = high - ratio * (high - low), low + ratio * (high - low)
        rising = sign * between(first, times, x, v, a) < sign * between(second, times, x, v, a)
        low, high = np.where(rising, first, low), np.where(rising, high, second)
    peaks = between(0.5 * (low + high), times, x, v, a) if len(turning) else np.empty(0)
    every = np.concatenate([x, peaks])
    return float(0.5 * (every.max() - every.min()))
