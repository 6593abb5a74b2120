# SPDX-License-Identifier: Apache-2.0
"""The best height as `best.py` has it, found sooner: what a selection on line and a map take.

A height counts there as here with its worst amplitude over several approach paths. First looks choose the heights that
are rated, the most promising first, and runs end as soon as their answer is due; so what is found is the best within
0.4 %, not the lowest within 0.2 % of it (docs/selection.md).

The search runs at the cheapest fidelity level whose model error is below the flatness of the optimum, and the height it
ends at is rated again at the complete one. Where the two disagree, the search goes on with the complete one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from atpid_sim.engine.state import State
from atpid_sim.maps.approaches import ALL_APPROACHES, Approach
from atpid_sim.maps.best import BELOW_RESONANCE, CLIMB, FLAT, LAST_BELOW, REPRODUCIBLE, Best, Mapper, promising
from atpid_sim.maps.response import NEVER, DamperResponse, Ending, Timing

#: Clearances tried first, as shares of the ballistic clearance: in the thesis's range the best lies at 0.44 to 0.82.
_FIRST, _LAST, _STEP = 0.30, 1.02, 0.08
#: Where, between irregular motions, narrow wells lie: there they are this far apart.
_NARROW, _COARSE = (0.46, 0.83), 0.02
#: Where one of two such amplitudes is less than this many times the least, the heights between are tried as well, that
#: far apart, or half as far.
_HOPEFUL = 1.25
#: Where the best lies at the end of what was tried, the range grows by this much, down to closed and up to this share.
_GROWTH, _HIGHEST, _LOWEST = 0.24, 2.0, 0.03
#: Finer grid around a promising clearance, in coarse steps, and heights tried between the best and the one below it.
_FINE, _BETWEEN = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75), 3
#: In an irregular motion a short window shows less than the worst: what its amplitude is multiplied by.
_IRREGULAR = 1.15
#: A height is not sought any more where another one might be better by this share only: so far first looks are off.
_NOTABLE = 4e-3
#: Heights whose clearances differ by at most this share are near each other: what one of them has turned out to be, the
#: other may be as well.
_NEAR = 0.002
#: Heights rated at most: where every one of many depends on the approach, the best of these is taken.
_MOST_RATED = 12
#: Surcharge on an amplitude that is not reproducible.
_SURCHARGE = 1.05
#: A run that comes to an amplitude this much above the best so far need not be finished.
_HOPELESS = 1.08
#: Wells whose clearances differ by this factor are far apart: between them the ceiling passes heights of
#: irregular motion.
_FAR = 1.1
#: Share of a clearance below which a height that is as good belongs to a plateau.
_PLATEAU = 0.97
#: Below resonance the best height lies at a cliff's edge, where instabilities grow slowly: how many times as long as a
#: rating it has to hold, by which share of its clearance it is lowered where it does not, and how often at most.
_LASTING, _BACK, _MOST_BACK = 4.0, 0.005, 6
#: How near to the steady motion a first look ends, and a rating, relative to the amplitude [-].
_CLOSE, _RATED_CLOSE = 5e-3, 5e-4
#: A rating settles this many times as long as a transient lasts, since close to the cliff an instability grows slowly.
_PATIENT = 1.5
#: How long a first look takes where the ceiling was raised from the height before.
_NEXT = Timing(8.0, 6.0)

Rated = tuple[float, float]  # height [m], rating [m]


@dataclass(frozen=True)
class Checked(Best):
    """A best height, and how far the levels agreed that it was searched and rated with."""

    searched: str  # fidelity level of the search
    checked: str  # and that at which the height was rated in the end
    disagreement: float  # of the two amplitudes, relative; above the flatness the search went on with the latter [-]


def quick_best(
    damper: DamperResponse,
    amplitude: float,
    hysteresis: float = 0.0,
    limits: tuple[float, float] = (0.0, math.inf),
    approaches: Sequence[Approach] = ALL_APPROACHES,
    mapper: Mapper = map,
) -> Checked:
    """Return the best height for a support amplitude [m]; arguments as of `best_height`, errors as well."""
    search = Search(damper, amplitude, limits, approaches, mapper)
    below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
    coarse = search.scan(damper.ballistic_clearance(amplitude), LAST_BELOW if below else _LAST)
    wells = [search.nearby(coarse, k) for k in promising([value for _, value in coarse])]
    search.between()
    height = search.best(search.heights)
    if below:
        height = search.held(search.climbed(height))
    if hysteresis > 0.0:
        height = _far_below(search, wells, height, hysteresis)
    worst = search.worst(height)
    return Checked(
        height=height,
        amplitude=worst,
        efficiency=1.0 - worst / damper.closed_amplitude(amplitude),
        reproducible=search.gap(height) <= REPRODUCIBLE,
        evaluations=search.evaluations,
        searched=search.quick.fidelity,
        checked=damper.fidelity,
        disagreement=search.disagreement,
    )


def _far_below(search: Search, wells: list[list[float]], height: float, hysteresis: float) -> float:
    """Return the best height [m] of the lowest well far below one that is not worse by `hysteresis`, or that itself."""
    limit = search.worst(height) * (1.0 + hysteresis)
    for well in sorted(wells):
        bottom = min(well, key=search.expected)
        if _FAR * (bottom - search.diameter) < height - search.diameter and search.expected(bottom) <= limit:
            lower = search.best(well)
            if _FAR * (lower - search.diameter) < height - search.diameter and search.expected(lower) <= limit:
                return lower
    return height


class Search:
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
    ) -> None:
        """See `quick_best`."""
        self._damper, self._amplitude, self._approaches, self._map = damper, amplitude, approaches, mapper
        self.quick = damper.sufficient(amplitude, FLAT)
        self.diameter = damper.diameter
        self._limits = max(limits[0], damper.diameter), limits[1]
        settle = damper.settling()
        self._short, self._long = Timing(0.8 * settle, 6.0), Timing(_PATIENT * settle, 16.0)
        self._looked: dict[float, tuple[float, State]] = {}  # height [m]: amplitude [m], last state
        self._rated: dict[float, list[float]] = {}  # height [m]: amplitude [m] of each approach path, quick
        self._checked: dict[float, list[float]] = {}  # the same, complete
        self.evaluations = 0
        self.disagreement = 0.0  # largest between two levels at a height, relative

    @property
    def heights(self) -> list[float]:
        """All heights looked at [m], rising."""
        return sorted(self._looked)

    def expected(self, height: float) -> float:
        """What is expected of a height [m] so far: the worst amplitude [m] with a surcharge, if it is rated.

        Otherwise the one seen first, which is raised as much as the rating of the nearest height has raised that.
        """
        found = self._checked.get(height) or self._rated.get(height)
        if found is not None:
            return max(found) * (1.0 if _gap(found) <= REPRODUCIBLE else _SURCHARGE)
        seen = self._looked[height][0]
        known = self._rated or self._checked
        nearest = min(known, key=lambda other: abs(other - height), default=math.inf)
        if abs(nearest - height) > _NEAR * (height - self.diameter):
            return seen
        return seen * max(self.expected(nearest) / self._looked[nearest][0], 1.0)

    def worst(self, height: float) -> float:
        """Largest amplitude [m] over the approaches to a height that was chosen."""
        return max(self._checked[height])

    def gap(self, height: float) -> float:
        """How far the approaches differ at a height that was chosen, relative to the worst."""
        return _gap(self._checked[height])

    def scan(self, unit: float, last: float) -> list[Rated]:
        """Return (height [m], amplitude [m]) over a range that has the least amplitude inside, not at an end.

        unit: ballistic clearance [m]; last: share of it at which the range ends at first. The closed damper is opened
        at once to some heights, more where narrow wells lie, which not every way leads to; between those that are not
        hopeless the ceiling is raised from the lower one.
        """
        first = _FIRST
        while True:
            shares = np.arange(first, last + 0.5 * _STEP, _STEP)
            heights = sorted({self._allowed(float(share), unit) for share in shares})
            self._look([(h,) for h in heights if h not in self._looked])
            values = [self._looked[h][0] for h in heights]
            lowest = next(k for k, value in enumerate(values) if value <= min(values) * (1.0 + _NOTABLE))
            if lowest == 0 and first > 2.0 * _LOWEST:
                first = max(_LOWEST, first - _GROWTH)
            elif lowest == len(heights) - 1 and last < _HIGHEST and heights[-1] < self._limits[1]:
                last += _GROWTH
            else:
                break
        limit, flat = _HOPEFUL * min(values), (1.0 + _NOTABLE) * min(values)
        narrow = {self._allowed(float(share), unit) for share in np.arange(*_NARROW, _COARSE)}
        self._look([(h,) for h in sorted(narrow) if h not in self._looked], limit)
        heights, values = self.heights, [self._looked[h][0] for h in self.heights]
        self._look(
            [
                (below, *self._between(below, above, unit))
                for k, (below, above) in enumerate(pairwise(heights))
                # where the grain no longer reaches the ceiling all heights are equal
                if min(values[k : k + 2]) <= limit and not (k > lowest and max(values[k : k + 2]) <= flat)
            ],
            limit,
        )
        return [(height, self._looked[height][0]) for height in self.heights]

    def climbed(self, height: float) -> float:
        """Return the best of a height [m] and those a little above it: below resonance it lies at the cliff's edge."""
        higher = [height + step * (height - self.diameter) for step in CLIMB]
        self._look([(height, *(h for h in higher if h <= self._limits[1] and h not in self._looked))])
        return self.best(self.heights)

    def held(self, height: float) -> float:
        """Return the first of a height [m] and those a little below it at which long runs come to the same amplitude.

        Where none is, the one with the least amplitude in them.
        """
        long = Timing(_LASTING * self._damper.settling(), _LASTING * self._long.window)
        tried = []
        for _ in range(_MOST_BACK):
            if height not in self._checked:
                self._checked[height] = self._rate(self._damper, height, NEVER)
            usual = max(self._checked[height])
            self._checked[height] = self._checked[height] + self._rate(self.quick, height, NEVER, long)
            tried.append(height)
            if max(self._checked[height]) <= (1.0 + REPRODUCIBLE) * usual:
                break
            height -= _BACK * (height - self.diameter)
        return min(tried, key=self.worst)

    def _allowed(self, share: float, unit: float) -> float:
        """Return the height [m] at a share of a clearance [m], within the limits."""
        return float(min(max(self.diameter + share * unit, self._limits[0]), self._limits[1]))

    def _between(self, below: float, above: float, unit: float) -> list[float]:
        """Heights [m] tried between two of the first ones."""
        narrow = _NARROW[0] <= (0.5 * (below + above) - self.diameter) / unit <= _NARROW[1]
        step = (0.5 if narrow else 1.0) * _COARSE * unit
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

        limit: amplitude [m] above which a height is hopeless.
        """
        jobs = [(one, Ending(_CLOSE, limit)) for one in sorted(series, key=len, reverse=True)]  # the longest first
        for found in self._map(self._first_looks, jobs):
            self._looked.update(found)
            self.evaluations += len(found)

    def _first_looks(self, job: tuple[Sequence[float], Ending]) -> dict[float, tuple[float, State]]:
        """Amplitudes [m] and last states, amplitudes raised where the motion is irregular."""
        found: dict[float, tuple[float, State]] = {}
        (first, *others), ending = job
        if first in self._looked:
            state = self._looked[first][1].copy()
        else:
            state = self.quick.closed_state(self._amplitude)
            found[first] = self._seen(state, first, self._short, ending), state.copy()
        for height in others:
            found[height] = self._seen(state, height, _NEXT, ending), state.copy()
        return found

    def _seen(self, state: State, height: float, timing: Timing, ending: Ending) -> float:
        path = ((state.time, height),)
        response = self.quick.follow_on(self._amplitude, state, path, timing, ending)
        return response.amplitude * (1.0 if response.regular else _IRREGULAR)

    def _lowest(self, heights: Sequence[float]) -> float:
        """Return the lowest height [m] of those expected to be equally good as the best."""
        expected = {height: self.expected(height) for height in heights}
        limit = (1.0 + FLAT) * min(expected.values())
        return min(height for height, value in expected.items() if value <= limit)

    def _next(self, heights: Sequence[float]) -> float:
        """Return the height [m] to be rated next, or one that is rated where no other is expected to be better."""
        rated = [height for height in heights if height in self._rated or height in self._checked]
        enough = len(rated) >= _MOST_RATED
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
        while True:
            height = self._next(heights)
            if height in self._checked:
                return self._first_of_plateau(heights, height)
            quick = self.quick is not self._damper and self.disagreement <= FLAT
            if quick and height not in self._rated:
                least = min((max(found) for found in self._rated.values()), default=math.inf)
                self._rated[height] = self._rate(self.quick, height, Ending(_RATED_CLOSE, _HOPELESS * least))
                continue
            before = self._rated.get(height)
            self._checked[height] = found = self._rate(self._damper, height, NEVER)
            if before:
                self.disagreement = max(self.disagreement, abs(max(found) / max(before) - 1.0))

    def _first_of_plateau(self, heights: Sequence[float], height: float) -> float:
        """Return the lowest of heights [m] far below one that are as good: there the grain never reaches the ceiling.

        The amplitude falls towards the cliff, so that heights that far below are not as good by chance.
        """
        limit, clearance = self.expected(height), _PLATEAU * (height - self.diameter)
        lower = [h for h in heights if h - self.diameter < clearance and self.expected(h) <= (1.0 + _NOTABLE) * limit]
        for candidate in lower[:_MOST_RATED]:
            if candidate not in self._checked:
                self._checked[candidate] = self._rate(self._damper, candidate, NEVER)
            if self.expected(candidate) <= (1.0 + FLAT) * limit:
                return candidate
        return height

    def _rate(self, damper: DamperResponse, height: float, ending: Ending, timing: Timing | None = None) -> list[float]:
        """Return the amplitudes [m] at a height [m] over all approach paths; timing: by default a rating's."""
        jobs = [(damper, height, approach, ending, timing or self._long) for approach in self._approaches]
        self.evaluations += len(jobs)
        return list(self._map(self._approached, jobs))

    def _approached(self, job: tuple[DamperResponse, float, Approach, Ending, Timing]) -> float:
        damper, height, approach, ending, timing = job
        path = approach(damper, height, 0.5 * damper.settling() * damper.period)
        state = damper.closed_state(self._amplitude)
        return damper.follow_on(self._amplitude, state, path, timing, ending).amplitude


def _gap(found: list[float]) -> float:
    """How far amplitudes differ, relative to the largest."""
    return (max(found) - min(found)) / max(found)
