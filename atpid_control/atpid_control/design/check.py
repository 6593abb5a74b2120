# SPDX-License-Identifier: Apache-2.0
"""The promise at amplitudes that the design was not made at: structures drawn anew, between its points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from atpid_control.design.cases import cases, inside
from atpid_control.design.problem import Problem
from atpid_control.design.promise import Answer, Interval, Point, answer

#: Structures drawn at each amplitude, half of them corners of the box, and the seed of the first.
DRAWN, _SEED = 32, 100


@dataclass(frozen=True)
class Check:
    """What the check found."""

    structures: int  # runs made
    outside: int  # of them beyond the interval
    excess: float  # by how much the farthest lies beyond, of the efficiency [-]


def between(points: Sequence[Point]) -> list[float]:
    """Return the amplitudes [m] half way between those of the points, in the logarithm."""
    amplitudes = [one.amplitude for one in points]
    return [float(np.sqrt(a * b)) for a, b in pairwise(amplitudes)]


def height_at(points: Sequence[Point], amplitude: float) -> float:
    """Return the design height [m] at a support amplitude [m] within the points: that of the height map."""
    return float(PchipInterpolator([p.amplitude for p in points], [p.height for p in points])(amplitude))


def interval_at(points: Sequence[Point], amplitude: float) -> Interval:
    """Return the promised efficiency at a support amplitude [m] within the points, straight in its logarithm."""
    at = np.log([one.amplitude for one in points])
    sides = np.transpose([one.efficiency for one in points])
    return Interval(*(float(np.interp(np.log(amplitude), at, side)) for side in sides))


def drawn(problem: Problem, fraction: float, points: Sequence[Point], place: int) -> list[Answer]:
    """Return the answers of structures drawn for the amplitude between points `place` and `place` + 1.

    Raises NumericalFailure.
    """
    amplitude = between(points)[place]
    height = height_at(points, amplitude)
    box = inside(DRAWN, _SEED + place)
    box[::2] = np.sign(box[::2])
    return [answer(one, amplitude, height) for one in cases(problem, fraction, box)]


def widened(points: Sequence[Point], found: Sequence[Sequence[Answer]]) -> tuple[list[Point], Check]:
    """Return the points, their intervals widened where an answer lies outside, and what the check found.

    found: the answers between points k and k + 1, for each k.
    """
    result = list(points)
    outside, farthest = 0, 0.0
    for place, amplitude in enumerate(between(points)):
        promised = interval_at(points, amplitude)
        below = max(0.0, promised.low - min(one.efficiency for one in found[place]))
        above = max(0.0, max(one.efficiency for one in found[place]) - promised.high)
        outside += sum(not promised.low <= one.efficiency <= promised.high for one in found[place])
        farthest = max(farthest, below, above)
        for k in (place, place + 1):
            result[k] = _wider(result[k], below, above)
    return result, Check(sum(map(len, found)), outside, farthest)


def _wider(one: Point, below: float, above: float) -> Point:
    efficiency, beam = one.efficiency, one.beam_amplitude
    return replace(
        one,
        efficiency=efficiency._replace(low=efficiency.low - below, high=min(efficiency.high + above, 1.0)),
        beam_amplitude=beam._replace(
            low=max(beam.low - above * one.closed_amplitude, 0.0), high=beam.high + below * one.closed_amplitude
        ),
    )
