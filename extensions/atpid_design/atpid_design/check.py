# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The promise at amplitudes that the design was not made at: structures drawn anew, between its points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from atpid_common.files import Document
from atpid_design.problem import Problem, cases, drawn_frequencies
from atpid_design.worst_case import Interval, Point, response_of
from atpid_sim.maps import ALL_APPROACHES
from atpid_sim.maps.curves import monotone
from atpid_sim.maps.ratings import at_once
from atpid_sim.robust import Response, inside

#: Structures drawn at each amplitude, half of them corners of the box, and the seed of the first.
_DRAWN, _SEED = 32, 100


@dataclass(frozen=True)
class Check:
    """What the check found."""

    structures: int  # runs made
    outside: int  # of them beyond the interval of the efficiency or of the reduction
    excess: float  # by how much the farthest lies beyond, of either [-]


def between(points: Sequence[Point]) -> list[float]:
    """Return the amplitudes [m] half way between those of the points, in the logarithm."""
    amplitudes = [one.amplitude for one in points]
    return [float(np.sqrt(a * b)) for a, b in pairwise(amplitudes)]


def height_at(points: Sequence[Point], amplitude: float) -> float:
    """Return the design height [m] at a support amplitude [m] within the points: that of the height map."""
    curve = monotone(np.array([p.amplitude for p in points]), np.array([p.height for p in points]))
    return float(curve(amplitude))


def interval_at(points: Sequence[Point], amplitude: float, name: str = "efficiency") -> Interval:
    """Return a promised interval at a support amplitude [m] within the points, straight in its logarithm.

    name: of the field of the points, `efficiency`, `reduction`, `beam_amplitude` or `bare_amplitude`; the amplitudes
    are read as multiples of that of the support.
    """
    at = np.log([one.amplitude for one in points])
    over = [one.amplitude if name.endswith("_amplitude") else 1.0 for one in points]
    sides = np.transpose([getattr(one, name) for one in points]) / over
    scale = amplitude if name.endswith("_amplitude") else 1.0
    return Interval(*(scale * float(np.interp(np.log(amplitude), at, side)) for side in sides))


def drawn(problem: Problem, fraction: float, points: Sequence[Point], place: int) -> list[Response]:
    """Return the responses of structures drawn for the amplitude between points `place` and `place` + 1.

    Raises NumericalFailure.
    """
    amplitude = between(points)[place]
    height = height_at(points, amplitude)
    box = inside(_DRAWN, problem.quantities, _SEED + place)
    box[::2] = np.sign(box[::2])
    at = drawn_frequencies(problem, _DRAWN, _SEED + place)
    # beside the resonance several motions exist, and which one is found depends on the path
    paths = (at_once,) if problem.excitation_frequency is None else ALL_APPROACHES
    return [
        response_of(one, amplitude, height, paths[k % len(paths)])
        for k, one in enumerate(cases(problem, fraction, box, at))
    ]


def widened(points: Sequence[Point], found: Sequence[Sequence[Response]]) -> tuple[list[Point], Check]:
    """Return the points, their intervals widened where a response lies outside, and what the check found.

    found: the responses between points k and k + 1, for each k.
    """
    result = list(points)
    outside, farthest = 0, 0.0
    for place, amplitude in enumerate(between(points)):
        beyond = np.zeros(len(found[place]), dtype=bool)
        for name in ("efficiency", "reduction", "beam_amplitude"):
            values = np.array([getattr(one, name.removeprefix("beam_")) for one in found[place]])
            promised = interval_at(points, amplitude, name)
            below = max(0.0, promised.low - float(values.min()))
            above = max(0.0, float(values.max()) - promised.high)
            share = name != "beam_amplitude"
            if share:
                beyond |= (values < promised.low) | (values > promised.high)
                farthest = max(farthest, below, above)
            for k in (place, place + 1):
                scale = 1.0 if share else points[k].amplitude / amplitude
                interval: Interval = getattr(result[k], name)
                low, high = interval.low - scale * below, interval.high + scale * above
                wide: Document = {name: interval._replace(low=low, high=min(high, 1.0) if share else high)}
                result[k] = replace(result[k], **wide)
        outside += int(beyond.sum())
    return result, Check(sum(map(len, found)), outside, farthest)
