# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The best height by a search that leaves out nothing: the reference that the packages' search is measured by.

It looks at a whole grid of heights, at the complete fidelity level, to the end of every run; of heights that are
equally good within 0.2 % the lowest is taken (docs/selection.md). Tables and pictures of best heights are made with it.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from atpid_sim.maps.build import FAR, Best
from atpid_sim.maps.height_search import BELOW_RESONANCE, CLIMB, HIGHEST, IRREGULAR, LAST_BELOW, promising
from atpid_sim.maps.ratings import ALL_APPROACHES, EXCEEDED, FLAT, REPRODUCIBLE, SURCHARGE, Approach, Mapper
from atpid_sim.maps.response import DamperResponse, Timing
from atpid_sim.simulation.quantities import efficiency

#: Clearances tried first, as shares of the ballistic clearance: in the thesis's range the best lies at 0.44 to 0.82.
_FIRST, _LAST, _STEP = 0.30, 1.00, 0.02
#: And heights of the scan rated besides those of the wells: so many over their range, and half as many of the best.
_OVERLOOKED = 8
#: Where, between irregular motions, narrow wells lie: there the steps are half as long.
_NARROW = (0.44, 0.83)
#: Where the best lies at the end of what was tried, the range grows by this much, down to closed.
_GROWTH = 0.2
#: Heights of it that are rated.
_RATED = 4
#: Finer grid around a promising clearance, in coarse steps.
_FINE = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
#: Heights tried between the best of the grid and the one below it.
_BETWEEN = 4

Rated = tuple[float, float]  # height [m], rating [m]


def thorough_best(
    damper: DamperResponse,
    amplitude: float,
    hysteresis: float = 0.0,
    limits: tuple[float, float] = (0.0, math.inf),
    approaches: Sequence[Approach] = ALL_APPROACHES,
    mapper: Mapper = map,
) -> Best:
    """Return the best height for a support amplitude [m]; arguments and errors as of `atpid_sim.maps.best_height`."""
    search = ThoroughSearch(damper, amplitude, limits, approaches, mapper)
    below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
    coarse = _scan(search, damper.ballistic_clearance(amplitude), LAST_BELOW if below else _LAST)
    wells = [search.nearby(coarse, k) for k in promising([value for _, value in coarse])]
    rated = search.rate({h for well in wells for h in well}, hysteresis)
    if below and (more := _overlooked(search, coarse, min(rated.values()))):
        wells.append(more)
        rated |= search.rate(more, hysteresis)
    height = _lowest(search, rated, coarse)
    least = min(rated.values())
    lower = _far_below(
        [{h: rated[h] for h in well} for well in wells], height, least * (1.0 + hysteresis), damper.diameter
    )
    if lower:
        height = _lowest(search, lower, coarse)
    if below:
        height = _climbed(search, height, damper.diameter)
    worst = search.worst(height)
    return Best(
        height=height,
        amplitude=worst,
        efficiency=efficiency(worst, damper.closed_amplitude(amplitude)),
        reproducible=search.gap(height) <= REPRODUCIBLE,
        evaluations=search.evaluations,
    )


class ThoroughSearch:
    """Rates heights at one amplitude and keeps the results."""

    def __init__(
        self,
        damper: DamperResponse,
        amplitude: float,
        limits: tuple[float, float],
        approaches: Sequence[Approach],
        mapper: Mapper,
    ) -> None:
        """See `thorough_best`."""
        self._damper, self._amplitude, self._approaches, self._map = damper, amplitude, approaches, mapper
        self._limits = max(limits[0], damper.diameter), limits[1]
        settle = damper.settling()
        self._short, self._long = Timing(0.8 * settle, 6.0), Timing(settle, 16.0)
        self._quick: dict[float, float] = {}
        self._found: dict[float, list[float]] = {}

    @property
    def evaluations(self) -> int:
        """Runs made so far."""
        return len(self._quick) + sum(map(len, self._found.values()))

    def allowed(self, share: float, unit: float) -> float:
        """Return the height [m] at a share of a clearance [m], within the limits."""
        return self.limited(self._damper.diameter + share * unit)

    def limited(self, height: float) -> float:
        """Return the allowed height [m] next to `height` [m]."""
        return float(min(max(height, self._limits[0]), self._limits[1]))

    def quick(self, heights: Sequence[float]) -> list[float]:
        """Amplitudes [m] when the closed damper is opened at once, raised where the motion is irregular."""
        new = [height for height in dict.fromkeys(heights) if height not in self._quick]
        self._quick.update(zip(new, self._map(self._opened, new), strict=True))
        return [self._quick[height] for height in heights]

    def nearby(self, coarse: list[Rated], k: int) -> list[float]:
        """Return the best few heights [m] of a finer grid around place k of the coarse one."""
        height = coarse[k][0]
        below, above = (abs(coarse[min(max(j, 0), len(coarse) - 1)][0] - height) for j in (k - 1, k + 1))
        finer = [height + part * (above if part > 0.0 else below) for part in _FINE]
        fine = list(dict.fromkeys(min(max(h, self._limits[0]), self._limits[1]) for h in finer))
        return [h for _, h in sorted(zip(self.quick(fine), fine, strict=True))[:_RATED]]

    def rate(self, heights: Iterable[float], hysteresis: float = 0.0, limit: float = math.inf) -> dict[float, float]:
        """Return {height: rating [m]}: the worst amplitude, with a surcharge where the approaches disagree.

        What exceeds the others by far, or exceeds `limit`, is infinite.
        """
        left = sorted(heights)
        rated = dict.fromkeys(left, math.inf)
        for approach in range(len(self._approaches)):
            jobs = [(height, approach) for height in left if len(self._found.setdefault(height, [])) == approach]
            for (height, _), value in zip(jobs, self._map(self._approached, jobs), strict=True):
                self._found[height].append(value)
            worst = {height: max(self._found[height][: approach + 1]) for height in left}
            bound = min(limit, EXCEEDED * (1.0 + hysteresis) * min(worst.values(), default=math.inf))
            left = [height for height in left if worst[height] <= bound]
        for height in left:
            rating = self.worst(height) * (1.0 if self.gap(height) <= REPRODUCIBLE else SURCHARGE)
            rated[height] = rating if rating <= limit else math.inf
        return rated

    def known(self, height: float) -> bool:
        """Whether a height [m] has been rated."""
        return height in self._found

    def worst(self, height: float) -> float:
        """Largest amplitude [m] over the approaches to a rated height."""
        return max(self._found[height])

    def gap(self, height: float) -> float:
        """How far the approaches differ, relative to the worst."""
        return (max(self._found[height]) - min(self._found[height])) / self.worst(height)

    def _opened(self, height: float) -> float:
        response = self._damper.opened(self._amplitude, height, self._short)
        return response.amplitude * (1.0 if response.regular else IRREGULAR)

    def _approached(self, job: tuple[float, int]) -> float:
        height, approach = job
        path = self._approaches[approach](self._damper, height, 0.5 * self._long.settle * self._damper.period)
        return self._damper.follow(self._amplitude, path, self._long).amplitude


def _scan(search: ThoroughSearch, unit: float, last: float) -> list[Rated]:
    """Return (height [m], amplitude [m]) over a range that has the least amplitude inside, not at an end."""
    first = _FIRST
    while True:
        shares = {*np.arange(first, last + 0.5 * _STEP, _STEP), *np.arange(*_NARROW, _STEP) + 0.5 * _STEP}
        heights = sorted({search.allowed(float(share), unit) for share in shares})
        values = search.quick(heights)
        lowest = next(k for k, value in enumerate(values) if value <= min(values) * (1.0 + FLAT))
        if lowest <= 1 and first > 2.0 * _STEP:
            first = max(_STEP, round((first - _GROWTH) / _STEP) * _STEP)
        elif lowest >= len(heights) - 2 and last < HIGHEST:
            last += _GROWTH
        else:
            return list(zip(heights, values, strict=True))


def _far_below(wells: list[dict[float, float]], height: float, limit: float, diameter: float) -> dict[float, float]:
    """Return the lowest well far below a height [m] whose rating is within `limit` [m]; empty where there is none."""
    far = [
        (bottom, well)
        for well in wells
        for bottom in [min(well, key=well.__getitem__)]
        if FAR * (bottom - diameter) < height - diameter and well[bottom] <= limit
    ]
    return min(far, key=lambda item: item[0], default=(0.0, {}))[1]


def _lowest(search: ThoroughSearch, rated: dict[float, float], coarse: list[Rated]) -> float:
    """Return the lowest height whose rating is within `FLAT` of the least, sought also below the best of the grid."""
    limit = (1.0 + FLAT) * min(rated.values())
    good = min(h for h, value in rated.items() if value <= limit)
    plateau = [h for h, value in coarse if value <= limit and h < good]
    good = min([h for h, value in search.rate(plateau, limit=limit).items() if value <= limit], default=good)
    bad = max([h for h in (*rated, *(h for h, _ in coarse)) if h < good], default=good)
    between = [bad + (good - bad) * k / (_BETWEEN + 1) for k in range(1, _BETWEEN + 1)] if bad < good else []
    return min([h for h, value in search.rate(between, limit=limit).items() if value <= limit], default=good)


def _overlooked(search: ThoroughSearch, coarse: list[Rated], least: float) -> list[float]:
    """Return heights [m] of the scan that may be better than the least rating [m] so far: the best, and some between.

    On a plateau, where the grain does not reach the ceiling, a well is the first of equals, which not all approaches
    may lead to; and a steady look at an irregular motion may show less than its surcharge.
    """
    better = [(v, h) for h, v in coarse if v < IRREGULAR * (1.0 - FLAT) * least and not search.known(h)]
    spread = better[:: max(1, math.ceil(len(better) / _OVERLOOKED))]
    return list(dict.fromkeys(h for _, h in [*sorted(better)[: _OVERLOOKED // 2], *spread]))


def _climbed(search: ThoroughSearch, height: float, diameter: float) -> float:
    """Return the best of a height and those a little above it, up to the cliff."""
    least = search.rate([height])[height]
    higher = {search.limited(height + step * (height - diameter)) for step in CLIMB}
    rated = search.rate(higher - {height}, limit=(1.0 - FLAT) * least)
    return min(rated, key=rated.__getitem__) if min(rated.values(), default=math.inf) < math.inf else height
