# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search for the best height at one amplitude: first looks at heights, then ratings of the most promising."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from atpid_sim.engine.state import State
from atpid_sim.maps.ratings import FLAT, Approach, Mapper, Ratings
from atpid_sim.maps.response import REPEATS, DamperResponse, EarlyEnd, Timing

#: Clearances tried first, as shares of the ballistic clearance: in the thesis's range the best lies at 0.44 to 0.82.
_FIRST, LAST, _STEP = 0.30, 1.02, 0.08
#: Below this share of the natural frequency it lies at up to 1.3, behind wells within the usual range.
BELOW_RESONANCE, LAST_BELOW = 0.95, 1.32
#: There the amplitude falls steeply up to the cliff: heights tried above the best, in steps of its clearance [-].
CLIMB = (0.006, 0.012, 0.018, 0.024)
#: In an irregular motion a short window shows less than the worst: what its amplitude is multiplied by.
IRREGULAR = 1.15
#: Where, between irregular motions, narrow wells lie: there they are this far apart.
_NARROW, _COARSE = (0.46, 0.83), 0.02
#: And where the narrowest of them lie, a hundredth of a clearance wide, that far apart: an irregular motion comes to
#: them only after a while.
_NARROWEST, _FINEST = (0.63, 0.69), 0.0025
#: Where one of two such amplitudes is less than this many times the least, the heights between are tried as well, that
#: far apart, or half as far.
_WORTH = 1.25
#: Where the best lies at the end of what was tried, the range grows by this much, down to this share and up to that.
_GROWTH, _LOWEST, HIGHEST = 0.24, 0.03, 2.0
#: How far a coarse amplitude may lie above the least to be looked at closely, and how many are.
_PROMISING, _CANDIDATES = 1.25, 4
#: Finer grid around a promising clearance, in coarse steps, and heights tried between the best and the one below it.
_FINE, _BETWEEN = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75), 3
#: A height is not sought any more where another one might be better by this share only: so far first looks are off.
_NOTABLE = 4e-3
#: Heights whose clearances differ by at most this share are near each other: what one of them has turned out to be, the
#: other may be as well.
_NEAR = 0.002
#: Heights rated at most, and below resonance: where every one of many depends on the approach, the best is taken.
_MOST_RATED, _MOST_BELOW = 14, 20
#: Share of a clearance below which a height that is as good belongs to a plateau.
_PLATEAU = 0.97
#: Below resonance the best height lies at a cliff's edge, where instabilities grow slowly: how many times as long as a
#: rating it has to hold, by which share of its clearance it is lowered where it does not, and how often at most.
_LASTING, _BACK, _MOST_BACK = 4.0, 0.005, 6
#: A wide search: from which restitution on it is made [-], clearances as shares of half a period's way at the closed
#: beam's greatest velocity, of how many local minima the surroundings are looked at, how many heights are rated, how
#: often a height that does not last in long runs, or to which one above is preferred, gives way to another, and by what
#: a look at an irregular motion is multiplied: on all its paths it comes to more, and regular ones are rated before.
WIDE = 0.2
_WIDE = np.concatenate([np.geomspace(0.02, 0.1, 65)[:-1], np.geomspace(0.1, 1.65, 350)])
_MINIMA, _MOST_WIDE, _MOST_GIVEN_UP, _LOOKED = 16, 40, 8, 1.4
#: It goes on so many times as long where the motion is irregular and less than this many times the least amplitude, and
#: follows regular motions to heights above and below by these shares of the clearance.
_LONGER, _WORTH_LONGER, _FOLLOWED = 3.0, 1.5, (0.2, -0.05)
#: How near to the steady motion a first look ends, relative to the amplitude [-].
_CLOSE = 5e-3
#: How long a first look takes where the ceiling was raised from the height before.
_NEXT = Timing(8.0, 6.0)

Rated = tuple[float, float]  # height [m], rating [m]


class _Look(NamedTuple):
    """What is seen at a height."""

    value: float  # amplitude [m], raised where the motion is irregular
    state: State  # at the end
    amplitude: float  # [m]
    regular: bool


class HeightSearch:
    """Looks at heights and rates them at one amplitude, and keeps the results.

    A height is looked at by one run of the quick level, then rated by all approach paths of that level, then of the
    complete one. What it is expected to come to is the result of the last of these.
    """

    def __init__(
        self,
        damper: DamperResponse,
        amplitude: float,
        limits: tuple[float, float],
        approaches: Sequence[Approach],
        mapper: Mapper,
        *,
        wide: bool = False,
    ) -> None:
        """See `best_height`; wide: where a grain rebounds so far that the best may lie anywhere."""
        self._damper, self._amplitude, self._map, self._wide = damper, amplitude, mapper, wide
        self.ratings = Ratings(damper, amplitude, approaches, mapper, IRREGULAR if wide else 1.0)
        self._quick = self.ratings.quick
        self.diameter = damper.diameter
        self._limits = max(limits[0], damper.diameter), limits[1]
        below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
        # below resonance wells lie beyond long irregular transients
        self._irregular, self._most = (1.0, _MOST_BELOW) if below else (IRREGULAR, _MOST_RATED)
        self._short = Timing(0.8 * damper.settling(), 6.0)
        if wide:
            self._irregular, self._most = _LOOKED, _MOST_WIDE
            self._short = Timing(damper.settling(), 16.0, REPEATS)
        self._looked: dict[float, _Look] = {}  # by height [m]
        self._looks = 0

    @property
    def heights(self) -> list[float]:
        """All heights looked at [m], rising."""
        return sorted(self._looked)

    @property
    def evaluations(self) -> int:
        """Runs made so far."""
        return self._looks + self.ratings.evaluations

    def expected(self, height: float) -> float:
        """What is expected of a height [m] so far: the worst amplitude [m] with a surcharge, if it is rated.

        Otherwise the one seen first, which is raised as much as the rating of the nearest height has raised that.
        """
        rated = self.ratings.heights
        if height in rated:
            return self.ratings.value(height)
        seen = self._looked[height].value
        # a height at which the motion lasts was rated without a look
        nearest = min(self._looked.keys() & set(rated), key=lambda other: abs(other - height), default=math.inf)
        if abs(nearest - height) > _NEAR * (height - self.diameter):
            return seen
        return seen * max(self.expected(nearest) / self._looked[nearest].value, 1.0)

    def scan(self, unit: float, last: float) -> list[Rated]:
        """Return (height [m], amplitude [m]) over a range that has the least amplitude inside, not at an end.

        unit: ballistic clearance [m]; last: share of it at which the range ends at first. The closed damper is opened
        at once to some heights, more where narrow wells lie, which not every way leads to; between those that promise
        enough the ceiling is raised from the lower one.
        """
        first = _FIRST
        while True:
            shares = np.arange(first, last + 0.5 * _STEP, _STEP).round(9)  # as those of the narrow wells
            heights = sorted({self._allowed(float(share), unit) for share in shares})
            self._look([(h,) for h in heights if h not in self._looked])
            values = [self._looked[h].value for h in heights]
            lowest = next(k for k, value in enumerate(values) if value <= min(values) * (1.0 + _NOTABLE))
            if lowest == 0 and first > 2.0 * _LOWEST:
                first = max(_LOWEST, first - _GROWTH)
            elif lowest == len(heights) - 1 and last < HIGHEST and heights[-1] < self._limits[1]:
                last += _GROWTH
            else:
                break
        narrow = {self._allowed(float(share), unit) for share in np.arange(*_NARROW, _COARSE).round(9)}
        self._look([(h,) for h in sorted(narrow) if h not in self._looked], _WORTH * min(values))
        heights, values = self.heights, [self._looked[h].value for h in self.heights]
        limit, flat = _WORTH * min(values), (1.0 + _NOTABLE) * min(values)
        lowest = next(k for k, value in enumerate(values) if value <= flat)
        between = []
        for k, (below, above) in enumerate(pairwise(heights)):
            narrowest = _NARROWEST[0] <= (0.5 * (below + above) - self.diameter) / unit <= _NARROWEST[1]
            # where the grain no longer reaches the ceiling all heights are equal
            equal = k > lowest and max(values[k : k + 2]) <= flat
            if (narrowest or min(values[k : k + 2]) <= limit) and not equal:
                between.append((below, *self._between(below, above, unit)))
        self._look(between, limit)
        return [(height, self._looked[height].value) for height in self.heights]

    def scan_widely(self) -> list[list[float]]:
        """Look at the whole range of heights, then closer around the least; return these surroundings [m]."""
        unit = math.pi * self._damper.closed_amplitude(self._amplitude)
        # to the end of each run: a transient may exceed for long what the motion comes to
        self._look([(h,) for h in {self._allowed(float(share), unit) for share in _WIDE}])
        limit = _WORTH_LONGER * min(one.amplitude for one in self._looked.values())
        # many irregular motions come to a regular one late
        late = [h for h, one in self._looked.items() if not one.regular and one.amplitude <= limit]
        self._looked.update(zip(late, self._map(self._longer, late), strict=True))
        self._looks += len(late)
        values = [self._looked[h].value for h in self.heights]
        minima = sorted(_minima(values), key=values.__getitem__)[:_MINIMA]
        coarse = list(zip(self.heights, values, strict=True))
        return [self.nearby(coarse, k) for k in minima]

    def _longer(self, height: float) -> _Look:
        after = replace(self._short, settle=_LONGER * self._short.settle)
        return self._seen(self._looked[height].state.copy(), height, after, EarlyEnd(_CLOSE))

    def _follow(self, height: float) -> None:
        """Look at what the motion at a height [m] comes to while the ceiling is moved, as far as it stays stable."""
        settled = self._longer(height)
        for part in _FOLLOWED if settled.regular else ():
            end = min(max(height + part * (height - self.diameter), self._limits[0]), self._limits[1])
            cliff = self._quick.cliff(self._amplitude, settled.state, height, end)
            for motion in cliff.branch if cliff else ():
                look = _Look(motion.amplitude, motion.state, motion.amplitude, regular=True)
                self._looked[motion.conditions.height] = look

    def lasting(self) -> float:
        """Return the best height [m] at which long runs come to the same amplitude, or the best with these counted."""
        tried: list[float] = []
        for _ in range(_MOST_GIVEN_UP):
            height = self.best(self.heights)
            self._follow(height)
            if self.climbed(height) == height:
                tried.append(height)
                if self.ratings.lasts(height, _LASTING):
                    break
        return min(tried or [height], key=self.ratings.value)

    def climbed(self, height: float) -> float:
        """Return the best of a height [m] and those a little above it: below resonance it lies at the cliff's edge."""
        higher = [height + step * (height - self.diameter) for step in CLIMB]
        self._look([(height, *(h for h in higher if h <= self._limits[1] and h not in self._looked))])
        return self.best(self.heights)

    def held(self, height: float) -> float:
        """Return the first of a height [m] and those a little below it at which long runs come to the same amplitude.

        Where none is, the one with the least amplitude in them.
        """
        tried = []
        for _ in range(_MOST_BACK):
            tried.append(height)
            if self.ratings.lasts(height, _LASTING) or height <= self._limits[0]:
                break
            height = max(height - _BACK * (height - self.diameter), self._limits[0])
        return min(tried, key=self.ratings.worst)

    def _allowed(self, share: float, unit: float) -> float:
        """Return the height [m] at a share of a clearance [m], within the limits."""
        return float(min(max(self.diameter + share * unit, self._limits[0]), self._limits[1]))

    def _between(self, below: float, above: float, unit: float) -> list[float]:
        """Heights [m] tried between two of the first ones."""
        share = (0.5 * (below + above) - self.diameter) / unit
        step = _COARSE * unit
        if _NARROWEST[0] <= share <= _NARROWEST[1]:
            step = _FINEST * unit
        elif _NARROW[0] <= share <= _NARROW[1]:
            step *= 0.5
        return [below + step * k for k in range(1, math.ceil((above - below) / step - 1e-6))]

    def nearby(self, coarse: list[Rated], k: int) -> list[float]:
        """Look at a finer grid around place k of the coarse one; return its heights [m]."""
        height, end = coarse[k][0], len(coarse) - 1
        start, above = coarse[max(k - 1, 0)][0], coarse[min(k + 1, end)][0]
        fine = [height + part * (above - height if part > 0.0 else height - start) for part in _FINE]
        new = sorted({h for h in fine if start < h <= self._limits[1] and h not in self._looked})
        self._look([(start, *new)])
        return sorted({start, height, above, *new})

    def between(self) -> None:
        """Look at heights between the lowest of the best and the one below it."""
        good = self._lowest(self.heights)
        below = [h for h in self.heights if h < good]
        if below:
            step = (good - below[-1]) / (_BETWEEN + 1)
            self._look([(below[-1], *(below[-1] + step * k for k in range(1, _BETWEEN + 1)))])

    def _look(self, series: Sequence[Sequence[float]], limit: float = math.inf) -> None:
        """Look at series of rising heights [m], each from the state of the one before it, the first from closed.

        limit: amplitude [m] above which a run need not be finished.
        """
        jobs = [(one, EarlyEnd(_CLOSE, limit)) for one in sorted(series, key=len, reverse=True)]  # the longest first
        for found in self._map(self._first_looks, jobs):
            self._looked.update(found)
            self._looks += len(found)

    def _first_looks(self, job: tuple[Sequence[float], EarlyEnd]) -> dict[float, _Look]:
        """Amplitudes [m] and last states, amplitudes raised where the motion is irregular."""
        found: dict[float, _Look] = {}
        (first, *others), ending = job
        if first in self._looked:
            state = self._looked[first].state.copy()
        else:
            state = self._quick.closed_state(self._amplitude)
            found[first] = self._seen(state, first, self._short, ending)
        for height in others:
            found[height] = self._seen(state, height, _NEXT, ending)
        return found

    def _seen(self, state: State, height: float, timing: Timing, ending: EarlyEnd) -> _Look:
        path = ((state.time, height),)
        response = self._quick.follow_on(self._amplitude, state, path, timing, ending)
        value = response.amplitude * (1.0 if response.regular else min(1.0 + response.variation, self._irregular))
        return _Look(value, state.copy(), response.amplitude, response.regular)

    def _lowest(self, heights: Sequence[float]) -> float:
        """Return the lowest height [m] of those expected to be equally good as the best."""
        expected = {height: self.expected(height) for height in heights}
        limit = (1.0 + FLAT) * min(expected.values())
        return min(height for height, value in expected.items() if value <= limit)

    def _next(self, heights: Sequence[float]) -> float:
        """Return the height [m] to be rated next, or one that is rated where no other is expected to be better."""
        rated = [height for height in heights if height in self.ratings.heights]
        enough = len(rated) >= self._most
        if rated and (enough or self._least(rated) <= (1.0 + _NOTABLE) * self._least(heights)):
            return self._lowest(rated)
        return self._lowest(heights)

    def _least(self, heights: Sequence[float]) -> float:
        return min(map(self.expected, heights))

    def best(self, heights: Sequence[float]) -> float:
        """Return the lowest of the best heights [m], rated at the complete level.

        What is expected of a height not yet rated is too little rather than too much, so the one that is best as far as
        is known is rated next, until none is expected to be notably better than the best that is rated.
        """
        while not self.ratings.complete(height := self._next(heights)):
            if self._wide and self._looked[height].regular:
                self.ratings.hopeful.add(height)
            self.ratings.go_on(height)
        return self._first_of_plateau(heights, height)

    def _first_of_plateau(self, heights: Sequence[float], height: float) -> float:
        """Return the lowest of heights [m] far below one that are as good: there the grain never reaches the ceiling.

        The amplitude falls towards the cliff, so that heights that far below are not as good by chance.
        """
        limit, clearance = self.expected(height), _PLATEAU * (height - self.diameter)
        lower = [h for h in heights if h - self.diameter < clearance and self.expected(h) <= (1.0 + _NOTABLE) * limit]
        for candidate in lower[: self._most]:
            if not self.ratings.checked(candidate):
                self.ratings.check(candidate)
            if self.expected(candidate) <= (1.0 + FLAT) * limit:
                return candidate
        return height


def promising(values: list[float]) -> list[int]:
    """Return the places of the deepest local minima, at most `_CANDIDATES`, of equal ones the first."""
    kept: list[int] = []
    for k in _minima(values):
        if not any(abs(values[j] - values[k]) <= FLAT * values[k] for j in kept):
            kept.append(k)
    return sorted(kept, key=lambda k: values[k])[:_CANDIDATES]


def _minima(values: list[float]) -> list[int]:
    """Return the places of the local minima that are deep enough."""
    padded = [math.inf, *values, math.inf]
    return [k for k, v in enumerate(values) if padded[k] >= v <= padded[k + 2] and v <= _PROMISING * min(values)]
