# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The best height: the lowest at which the beam's amplitude is least, by whichever path the ceiling approached.

The optimum stands at a cliff: above it the motion is irregular, and what a run shows there depends on the start. So a
height counts with its *worst* amplitude over several approach paths (opened from closed at once, opened slowly,
raised from below, lowered from above), where these disagree with a surcharge (docs/selection.md).

First looks choose the heights that are rated, the most promising first, and runs end as soon as their answer is due; so
what is found is the best within 0.4 %. The search runs at the cheapest fidelity level whose model error is below the
flatness of the optimum, and the height it ends at is rated again at the complete one. Where the two disagree, the
search goes on with the complete one. `studies/thorough_search.py` is the search it is measured by.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from atpid_sim.maps.approaches import ALL_APPROACHES, Approach
from atpid_sim.maps.height_search import BELOW_RESONANCE, LAST, LAST_BELOW, WIDE, HeightSearch, promising
from atpid_sim.maps.ratings import Mapper
from atpid_sim.maps.response import DamperResponse
from atpid_sim.results import Labelled, in_unit
from atpid_sim.simulation.quantities import efficiency

#: Wells whose clearances differ by this factor are far apart: between them the ceiling passes heights of
#: irregular motion.
FAR = 1.1


@dataclass(frozen=True, repr=False)
class Best(Labelled):
    """A best height, what it is worth, and how far the levels agreed that it was searched and rated with."""

    height: float  # [m]
    amplitude: float  # worst half peak-to-peak of the beam over the approach paths [m]
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-]
    reproducible: bool  # all approach paths end in the same motion
    evaluations: int
    searched: str = ""  # fidelity level of the search
    checked: str = ""  # and that at which the height was rated in the end
    #: Largest of the two amplitudes where both are reproducible, relative; 0: none was; above the flatness the search
    #: went on with the latter [-].
    disagreement: float = 0.0

    labels = in_unit("m", "height amplitude")


def best_height(
    damper: DamperResponse,
    amplitude: float,
    hysteresis: float = 0.0,
    limits: tuple[float, float] = (0.0, math.inf),
    approaches: Sequence[Approach] = ALL_APPROACHES,
    mapper: Mapper = map,
) -> Best:
    """Return the best height for a support amplitude [m]. Raises NumericalFailure where a run fails.

    hysteresis: where there are several wells far apart, the lowest is kept unless another is better by more than this
    share; with 0 the deepest is taken. A map follows one well, because it is interpolated between its points.
    limits: lowest and highest height allowed [m]; approaches: paths by which the ceiling may come to a height.
    """
    wide = damper.restitution(amplitude) > WIDE
    search = HeightSearch(damper, amplitude, limits, approaches, mapper, wide=wide)
    below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
    if wide:
        wells = search.scan_widely()
        height = search.lasting()
    else:
        coarse = search.scan(damper.ballistic_clearance(amplitude), LAST_BELOW if below else LAST)
        wells = [search.nearby(coarse, k) for k in promising([value for _, value in coarse])]
        search.between()
        height = search.best(search.heights)
    if below and not wide:
        height = search.held(search.climbed(height))
    if hysteresis > 0.0:
        height = _far_below(search, wells, height, hysteresis)
    worst = search.ratings.worst(height)
    return Best(
        height=height,
        amplitude=worst,
        efficiency=efficiency(worst, damper.closed_amplitude(amplitude)),
        reproducible=search.ratings.reproducible(height),
        evaluations=search.evaluations,
        searched=search.ratings.quick.fidelity,
        checked=damper.fidelity,
        disagreement=search.ratings.disagreement,
    )


def _far_below(search: HeightSearch, wells: list[list[float]], height: float, hysteresis: float) -> float:
    """Return the best height [m] of the lowest well far below one that is not worse by `hysteresis`, or that itself."""
    limit = search.ratings.worst(height) * (1.0 + hysteresis)
    for well in sorted(wells):
        bottom = min(well, key=search.expected)
        if FAR * (bottom - search.diameter) < height - search.diameter and search.expected(bottom) <= limit:
            lower = search.best(well)
            if FAR * (lower - search.diameter) < height - search.diameter and search.expected(lower) <= limit:
                return lower
    return height
