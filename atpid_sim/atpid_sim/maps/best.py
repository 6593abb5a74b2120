# SPDX-License-Identifier: Apache-2.0
"""The best height: the lowest at which the beam swings least, whichever way the ceiling came.

The optimum stands at a cliff: above it the motion is irregular, and what a run shows there depends on the start. So a
height counts with its *worst* amplitude over four ways of getting there (opened from closed at once, opened slowly,
lowered from above, raised from below), where these disagree with a surcharge, and of heights that are equally good the
lowest is taken (docs/selection.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from atpid_sim.maps.rig import Rig, Timing

#: Clearances tried first, as shares of the ballistic clearance: in the thesis's range the best lies at 0.44 to 0.82.
_FIRST, _LAST, _STEP = 0.30, 1.00, 0.02

#: Where the best lies at the end of what was tried, the range grows by this much, down to closed and up to this share.
_GROWTH, _HIGHEST = 0.2, 2.0

#: Finer grid around a promising clearance, in coarse steps.
_FINE = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)

#: How far a coarse amplitude may lie above the least to be looked at closely, and how many are.
_PROMISING, _CANDIDATES, _RATED = 1.2, 3, 8

#: Heights whose amplitudes differ by less than this share are equally good [-].
FLAT = 2e-3

#: Where the ways to a height end in amplitudes further apart than this, its motion is not reproducible: a surcharge.
REPRODUCIBLE, _SURCHARGE = 1e-2, 1.05

#: Time the ceiling takes for slow travels [s]: the thesis's opening time.
_TRAVEL = 1.0

_BISECTIONS = 5

Rating = Callable[[float, float], float]


@dataclass(frozen=True)
class Best:
    """A best height and what it is worth."""

    height: float  # [m]
    amplitude: float  # worst half peak-to-peak of the beam over the ways of getting there [m]
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-]
    reproducible: bool  # all ways of getting there end in the same motion
    evaluations: int


def best_height(rig: Rig, amplitude: float) -> Best:
    """Return the best height for a support amplitude [m]. Raises NumericalFailure where a run fails."""
    search = _Search(rig, amplitude)
    coarse = _scan(search, rig, rig.ballistic_clearance(amplitude))
    step = coarse[1][0] - coarse[0][0]
    fine = {h for k in promising([v for _, v in coarse]) for h in _around(coarse[k][0], step, rig.diameter)}
    near = sorted(((search.quick(h), h) for h in fine))[:_RATED]
    rated = _rate(search.rating, [h for _, h in near])
    height = _lowest(search.rating, rated, coarse)
    worst = search.worst(height)
    return Best(
        height=height,
        amplitude=worst,
        efficiency=1.0 - worst / rig.closed_amplitude(amplitude),
        reproducible=search.gap(height) <= REPRODUCIBLE,
        evaluations=search.evaluations,
    )


def promising(values: list[float]) -> list[int]:
    """Return the places of the deepest local minima, at most `_CANDIDATES`, of equal ones the first."""
    padded = [math.inf, *values, math.inf]
    minima = [k for k, v in enumerate(values) if padded[k] >= v <= padded[k + 2] and v <= _PROMISING * min(values)]
    kept: list[int] = []
    for k in minima:
        if not any(abs(values[j] - values[k]) <= FLAT * values[k] for j in kept):
            kept.append(k)
    return sorted(kept, key=lambda k: values[k])[:_CANDIDATES]


class _Search:
    """Rates heights and remembers what it found."""

    def __init__(self, rig: Rig, amplitude: float) -> None:
        self._rig, self._amplitude = rig, amplitude
        settle = rig.settling()
        self._short, self._long = Timing(0.8 * settle, 6.0), Timing(settle, 16.0)
        self._quick: dict[float, float] = {}
        self._ways: dict[float, list[float]] = {}

    @property
    def evaluations(self) -> int:
        """Runs made so far."""
        return len(self._quick) + sum(map(len, self._ways.values()))

    def quick(self, height: float) -> float:
        """Amplitude [m] when the closed damper is opened at once."""
        if height not in self._quick:
            self._quick[height] = self._rig.opened(self._amplitude, height, self._short)
        return self._quick[height]

    def rating(self, height: float, limit: float = math.inf) -> float:
        """Worst amplitude [m], with the surcharge where the ways disagree; infinite as soon as `limit` is exceeded."""
        if any(way > limit for way in self._each_way(height)):
            return math.inf
        rating = self.worst(height) * (1.0 if self.gap(height) <= REPRODUCIBLE else _SURCHARGE)
        return rating if rating <= limit else math.inf

    def worst(self, height: float) -> float:
        """Largest amplitude [m] over the ways to this height."""
        return max(self._each_way(height))

    def gap(self, height: float) -> float:
        """How far the ways differ, relative to the worst."""
        ways = list(self._each_way(height))
        return (max(ways) - min(ways)) / max(ways)

    def _each_way(self, height: float) -> Iterator[float]:
        rig, a, long = self._rig, self._amplitude, self._long
        known = self._ways.setdefault(height, [])
        ways = (
            lambda: rig.raised(a, height, long, _TRAVEL),
            lambda: rig.lowered(a, height, long, _TRAVEL),
            lambda: rig.opened(a, height, long, _TRAVEL),
            lambda: rig.opened(a, height, long),
        )
        for k, way in enumerate(ways):
            if k == len(known):
                known.append(way())
            yield known[k]


def _scan(search: _Search, rig: Rig, unit: float) -> list[tuple[float, float]]:
    """Return (height [m], amplitude [m]) over a range that has the least amplitude inside, not at an end."""
    shares = list(np.arange(_FIRST, _LAST + 0.5 * _STEP, _STEP))
    while True:
        coarse = [(float(rig.diameter + share * unit), 0.0) for share in shares]
        coarse = [(h, search.quick(h)) for h, _ in coarse]
        least = min(range(len(coarse)), key=lambda k: coarse[k][1])
        lower = next(k for k, (_, v) in enumerate(coarse) if v <= coarse[least][1] * (1.0 + FLAT))
        if lower <= 1 and shares[0] > 2.0 * _STEP:
            shares = [*np.arange(max(_STEP, shares[0] - _GROWTH), shares[0] - 0.5 * _STEP, _STEP), *shares]
        elif lower >= len(shares) - 2 and shares[-1] < _HIGHEST:
            shares = [*shares, *np.arange(shares[-1] + _STEP, shares[-1] + _GROWTH + 0.5 * _STEP, _STEP)]
        else:
            return coarse


def _around(height: float, step: float, lowest: float) -> Iterator[float]:
    return (float(max(lowest, height + step * part)) for part in _FINE)


def _rate(rate: Rating, heights: list[float]) -> list[tuple[float, float]]:
    """Return (height [m], rating [m]); a height is given up as soon as it is surely worse than the best so far."""
    rated: list[tuple[float, float]] = []
    limit = math.inf
    for height in heights:
        rated.append((height, rate(height, limit)))
        limit = min(limit, rated[-1][1] * (1.0 + FLAT))
    return rated


def _lowest(rate: Rating, rated: list[tuple[float, float]], coarse: list[tuple[float, float]]) -> float:
    """Return the lowest height whose rating is within `FLAT` of the least, by bisection below the best of the grid."""
    limit = (1.0 + FLAT) * min(value for _, value in rated)
    good = min(h for h, value in rated if value <= limit)
    plateau = (h for h, value in coarse if value <= limit and h < good)
    good = next((h for h in plateau if rate(h, limit) <= limit), good)
    bad = max([h for h, _ in (*rated, *coarse) if h < good], default=good)
    for _ in range(_BISECTIONS if bad < good else 0):
        middle = 0.5 * (bad + good)
        good, bad = (middle, bad) if rate(middle, limit) <= limit else (good, middle)
    return good
