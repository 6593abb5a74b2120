# SPDX-License-Identifier: Apache-2.0
"""The best height as `best.py` has it, found sooner: what a selection on line and a map take.

A height counts there as here with its worst amplitude over several approach paths. First looks choose the heights that
are rated, the most promising first, and runs end as soon as their answer is due; so what is found is the best within
0.4 %, not the lowest within 0.2 % of it (docs/selection.md).

The search runs at the cheapest fidelity level whose model error is below the flatness of the optimum, and the height it
ends at is rated again at the complete one. Where the two disagree, the search goes on with the complete one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from atpid_sim.maps.approaches import ALL_APPROACHES, Approach
from atpid_sim.maps.best import BELOW_RESONANCE, FAR, LAST_BELOW, Best, Mapper, promising
from atpid_sim.maps.quick_search import LAST, QuickSearch
from atpid_sim.maps.response import DamperResponse


@dataclass(frozen=True)
class Checked(Best):
    """A best height, and how far the levels agreed that it was searched and rated with."""

    searched: str  # fidelity level of the search
    checked: str  # and that at which the height was rated in the end
    #: Largest of the two amplitudes where both are reproducible, relative; 0: none was; above the flatness the search
    #: went on with the latter [-].
    disagreement: float


def quick_best(
    damper: DamperResponse,
    amplitude: float,
    hysteresis: float = 0.0,
    limits: tuple[float, float] = (0.0, math.inf),
    approaches: Sequence[Approach] = ALL_APPROACHES,
    mapper: Mapper = map,
) -> Checked:
    """Return the best height for a support amplitude [m]; arguments as of `best_height`, errors as well."""
    search = QuickSearch(damper, amplitude, limits, approaches, mapper)
    below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
    coarse = search.scan(damper.ballistic_clearance(amplitude), LAST_BELOW if below else LAST)
    wells = [search.nearby(coarse, k) for k in promising([value for _, value in coarse])]
    search.between()
    height = search.best(search.heights)
    if below:
        height = search.held(search.climbed(height))
    if hysteresis > 0.0:
        height = _far_below(search, wells, height, hysteresis)
    worst = search.ratings.worst(height)
    return Checked(
        height=height,
        amplitude=worst,
        efficiency=1.0 - worst / damper.closed_amplitude(amplitude),
        reproducible=search.ratings.reproducible(height),
        evaluations=search.evaluations,
        searched=search.ratings.quick.fidelity,
        checked=damper.fidelity,
        disagreement=search.ratings.disagreement,
    )


def _far_below(search: QuickSearch, wells: list[list[float]], height: float, hysteresis: float) -> float:
    """Return the best height [m] of the lowest well far below one that is not worse by `hysteresis`, or that itself."""
    limit = search.ratings.worst(height) * (1.0 + hysteresis)
    for well in sorted(wells):
        bottom = min(well, key=search.expected)
        if FAR * (bottom - search.diameter) < height - search.diameter and search.expected(bottom) <= limit:
            lower = search.best(well)
            if FAR * (lower - search.diameter) < height - search.diameter and search.expected(lower) <= limit:
                return lower
    return height
