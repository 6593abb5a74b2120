# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Trends: the slope of a quantity over the hours, with its error, against zero."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from atpid_sim.system import Array

#: The begin of a leg that is left out, the longer of both: caches fill, the allocator takes what it needs [share, s].
WARM_UP, WARMEST = 0.2, 120.0
#: Neighbouring samples depend on each other, means over as many parts of a leg hardly.
PARTS = 10
#: Probability with which a slope that is zero is called one.
_ERROR = 1e-3


@dataclass(frozen=True)
class Trend:
    """A quantity's straight line over the time of a soak, with an offset of each leg."""

    name: str
    unit: str
    mean: float
    last: float
    slope: float  # [unit/h]; NaN: too few samples
    error: float  # standard deviation of the slope [unit/h]
    least: float  # a slope below this does not matter [unit/h]
    significant: bool  # beyond its error, above zero

    @property
    def grows(self) -> bool:
        """Whether it grows, by more than its error and by more than matters."""
        return self.significant and self.slope > self.least

    @property
    def verdict(self) -> str:
        """In one word."""
        if not math.isfinite(self.slope):
            return "too short"
        return "grows" if self.grows else "flat"


def trend(name: str, unit: str, legs: Sequence[int], times: Sequence[float], values: Sequence[float],
          least: float, warm_up: bool = True) -> Trend:  # fmt: skip
    """Return the trend of `values` (n,) at `times` (n,) [s] within `legs` (n,).

    Means of ten parts of each leg after its warm-up are fitted by one slope and an offset a leg; the error is theirs,
    by Student's t. A leg that ends early counts by its own length. warm_up: whether its begin is left out.
    """
    leg, time, value = np.asarray(legs), np.asarray(times, dtype=float) / 3600.0, np.asarray(values, dtype=float)
    known = np.isfinite(value)
    leg, time, value = leg[known], time[known], value[known]
    parts = [part for number in np.unique(leg) for part in _parts(time[leg == number], value[leg == number], warm_up)]
    slope, error, freedom = _slope(parts)
    limit = stats.t.isf(_ERROR, freedom) if freedom > 0 else math.inf
    mean = float(value.mean()) if len(value) else math.nan
    last = float(value[-1]) if len(value) else math.nan
    return Trend(name, unit, mean, last, slope, error, least, bool(slope > limit * error))


def _parts(time: Array, value: Array, warm_up: bool) -> list[tuple[Array, Array]]:
    """Return one pair of a leg's part means (k,), (k,), each less its mean over the leg; none for a short leg."""
    if not len(time):
        return []
    kept = time >= (max(WARM_UP * time[-1], WARMEST / 3600.0) if warm_up else 0.0)
    pieces = [piece for piece in np.array_split(np.flatnonzero(kept), PARTS) if len(piece)]
    if len(pieces) < 3:
        return []
    at, of = (np.array([series[piece].mean() for piece in pieces]) for series in (time, value))
    return [(at - at.mean(), of - of.mean())]


def _slope(parts: list[tuple[Array, Array]]) -> tuple[float, float, int]:
    """Return slope, its standard deviation and the degrees of freedom."""
    if not parts:
        return math.nan, math.nan, 0
    time, value = (np.concatenate(series) for series in zip(*parts, strict=True))
    freedom, spread = len(time) - len(parts) - 1, float(time @ time)
    if freedom < 1 or not spread:
        return math.nan, math.nan, 0
    slope = float(time @ value) / spread
    residual = value - slope * time
    return slope, math.sqrt(float(residual @ residual) / freedom / spread), freedom
