# SPDX-License-Identifier: Apache-2.0
"""One support amplitude: the height that is best in the worst case, and the response to be expected there.

The rule. Heights from the bare optimum downwards are rated by the largest amplitude over the corners of the box of
uncertainties, an irregular motion counted half as much again. The best of them, and up to two heights below it, are
then rated over all cases: both ways of opening, all approach paths of the given structure, the corners with the largest
and the least amplitude and efficiency by the main effects, and random structures inside the box. The least of these is
the design height; the interval is what the cases span there, and half a point for what lies between them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from atpid_control.design.cases import Case, adverse, case, cases, corners, inside
from atpid_control.design.forces import Forces, forces
from atpid_control.design.problem import Problem
from atpid_sim.maps import ALL_APPROACHES, FROM_CLOSED, Approach, Timing, best_height
from atpid_sim.maps.approaches import at_once, opened
from atpid_sim.maps.best import FLAT, Best

#: Heights tried, as shares of the bare optimum's clearance: so many at a time, so far apart, down to the least.
_BATCH, _STEP, _LEAST = 8, 0.03, 0.2
#: Heights below the best that are rated over all cases as well.
_LOWER = 2
#: An irregular motion counts as this many times as large: the design is to avoid it.
_RUMBLE = 1.5
#: A longer window shows so much more of an irregular motion than the one used [-].
_IRREGULAR = 0.15
#: What lies between the cases and between the amplitudes may be so much farther out: efficiency [-].
_UNSEEN = 0.005
#: Random structures inside the box, and the seed that draws them.
_RANDOM, _SEED = 24, 1
#: Heights are read between the amplitudes, as in a map: a well far above another has to be better by this share [-].
_HYSTERESIS = 0.15
#: Periods in which an amplitude is taken.
_WINDOW = 16.0
#: Relative tolerance of the run that shows the numerical error.
_FINE = 1e-8


class Interval(NamedTuple):
    """What is expected of the given structure, and the least and the largest over all cases."""

    expected: float
    low: float
    high: float


class Answer(NamedTuple):
    """The response of one case."""

    amplitude: float  # of the beam, half peak-to-peak [m]
    efficiency: float  # 1 - amplitude / amplitude of the same structure with the damper closed [-]
    regular: bool

    @property
    def rating(self) -> float:
        """The amplitude [m], raised where the motion is irregular."""
        return self.amplitude * (1.0 if self.regular else _RUMBLE)


@dataclass(frozen=True)
class Point:
    """The design at one support amplitude."""

    amplitude: float  # of the support [m]
    height: float  # of the ceiling [m]
    clearance: float  # height less the grain's diameter [m]
    efficiency: Interval  # [-]
    beam_amplitude: Interval  # [m]
    closed_amplitude: float  # of the given structure, damper closed [m]
    best_height: float  # the bare optimum of the given structure [m]
    best_efficiency: float  # there [-]
    regular: bool  # in every case
    numerical_error: float  # of the amplitude, relative [-]
    ceiling_force: Interval  # largest force on the ceiling, over the corners [N]
    floor_force: float  # largest, over the corners [N]
    overlap: float  # deepest, over the corners, over the grain's radius [-]
    speed: float  # largest closing speed at the ceiling, over the corners [m/s]
    impulse: float  # of an impact on the ceiling, given structure [N s]
    rate: float  # impacts on the ceiling, given structure [1/s]
    mean_force: float  # on the ceiling, given structure [N]
    acceleration: float  # of the closed damper over gravity, omega^2 X_0 / g; infinite without gravity [-]
    structures: int  # cases that the intervals are taken over


@dataclass(frozen=True)
class Structures:
    """The given structure, the corners of the box and random structures inside, with one grain."""

    problem: Problem
    fraction: float
    given: Case
    corners: Sequence[Case]
    random: Sequence[Case]

    @staticmethod
    def of(problem: Problem, fraction: float) -> "Structures":
        """Return the structures with a grain of a mass fraction [-]. Raises SceneError where a value cannot be."""
        return Structures(
            problem, fraction, case(problem, fraction), list(cases(problem, fraction, corners())),
            list(cases(problem, fraction, inside(_RANDOM, _SEED))),
        )  # fmt: skip

    def bare(self, amplitude: float) -> Best:
        """Return the best height of the given structure. Raises NumericalFailure."""
        limits = 2.0 * self.given.damper.system.radius, self.problem.max_height
        return best_height(self.given.damper, amplitude, _HYSTERESIS, limits, FROM_CLOSED)


def answer(one: Case, amplitude: float, height: float, approach: Approach = at_once) -> Answer:
    """Return the response of a case to an identified amplitude and a commanded height [m]. Raises NumericalFailure."""
    damper, true = one.damper, one.amplitude(amplitude)
    settle = damper.settling()
    path = approach(damper, one.height(height), 0.5 * settle * damper.period)
    response = damper.follow(true, path, Timing(settle, _WINDOW))
    return Answer(response.amplitude, 1.0 - response.amplitude / damper.closed_amplitude(true), response.regular)


def rated_heights(
    structures: Structures, amplitude: float, best: Best, every: int = 1
) -> dict[float, list[Answer]]:  # fmt: skip
    """Return {height [m]: answers of the given structure and of the corners}, from the bare optimum down.

    Heights are added until the best lies inside; every: 2 leaves out each second one. Raises NumericalFailure.
    """
    diameter = structures.given.damper.diameter
    clearance, share = best.height - diameter, 1.0
    rated: dict[float, list[Answer]] = {}
    while share > _LEAST and (not rated or worst(list(rated.values())[-1]) <= least(rated) * (1.0 + FLAT)):
        for k in range(0, _BATCH, every):
            height = diameter + clearance * (share - _STEP * k)
            rated[height] = [answer(one, amplitude, height) for one in (structures.given, *structures.corners)]
        share -= _STEP * _BATCH
    return rated


def worst(answers: Sequence[Answer]) -> float:
    """Return the largest rating [m]."""
    return max(one.rating for one in answers)


def least(rated: dict[float, list[Answer]]) -> float:
    """Return the smallest of the largest ratings [m]."""
    return min(map(worst, rated.values()))


def lowest_best(rated: dict[float, list[Answer]]) -> float:
    """Return the lowest height [m] whose largest rating is within `FLAT` of the least."""
    limit = least(rated) * (1.0 + FLAT)
    return min(height for height, answers in rated.items() if worst(answers) <= limit)


def point(structures: Structures, amplitude: float) -> Point:
    """Return the design at a support amplitude [m]. Raises NumericalFailure."""
    best = structures.bare(amplitude)
    rated = rated_heights(structures, amplitude, best)
    good = lowest_best(rated)
    lower = sorted((height for height in rated if height <= good), reverse=True)[: _LOWER + 1]
    full = {height: _all_answers(structures, amplitude, height, rated[height]) for height in lower}
    height = lowest_best(full)
    return _described(structures, amplitude, height, full[height], best)


def _all_answers(structures: Structures, amplitude: float, height: float, known: Sequence[Answer]) -> list[Answer]:
    """Return the answers of all cases at a height [m], the given structure's first; `known`: those of the corners."""
    run: Callable[..., Answer] = partial(answer, amplitude=amplitude, height=height)
    box = corners()
    extreme = [
        adverse(box, np.array([getattr(one, name) for one in known[1:]])) for name in ("amplitude", "efficiency")
    ]
    ends = list(
        cases(structures.problem, structures.fraction, np.array([side * e for e in extreme for side in (1, -1)]))
    )
    return [
        *known,
        *(run(structures.given, approach=approach) for approach in ALL_APPROACHES),
        *(run(one, approach=opened) for one in structures.corners),
        *(run(one, approach=approach) for one in ends for approach in (at_once, opened)),
        *(run(one) for one in structures.random),
    ]


def _described(structures: Structures, amplitude: float, height: float, answers: list[Answer], best: Best) -> Point:
    problem, fraction, given = structures.problem, structures.fraction, structures.given
    damper, expected = given.damper, answers[0]
    fine = answer(case(problem, fraction, rtol=_FINE), amplitude, height).amplitude
    error = abs(fine / expected.amplitude - 1.0)
    regular = all(one.regular for one in answers)
    wider = error + (0.0 if regular else _IRREGULAR)
    lowest, highest = min(one.efficiency for one in answers), max(one.efficiency for one in answers)
    felt = [forces(one, amplitude, height) for one in (given, *structures.corners)]
    hardest = adverse(corners(), np.array([one.ceiling for one in felt[1:]]))
    felt += [forces(one, amplitude, height) for one in cases(problem, fraction, np.array([hardest, -hardest]))]
    gravity, omega = problem.gravity, 2.0 * np.pi * damper.frequency
    closed = damper.closed_amplitude(amplitude)
    return Point(
        amplitude=amplitude,
        height=height,
        clearance=height - damper.diameter,
        efficiency=Interval(
            expected.efficiency,
            lowest - wider * (1.0 - lowest) - _UNSEEN,
            min(highest + wider * (1.0 - highest) + _UNSEEN, 1.0),
        ),
        beam_amplitude=Interval(
            expected.amplitude,
            max(min(one.amplitude for one in answers) * (1.0 - wider) - _UNSEEN * closed, 0.0),
            max(one.amplitude for one in answers) * (1.0 + wider) + _UNSEEN * closed,
        ),
        closed_amplitude=closed,
        best_height=best.height,
        best_efficiency=best.efficiency,
        regular=regular,
        numerical_error=error,
        structures=len(answers),
        acceleration=omega**2 * closed / gravity if gravity > 0.0 else float("inf"),
        **_forces(felt, damper.system.radius),
    )


def _forces(felt: Sequence[Forces], radius: float) -> dict[str, Any]:
    given = felt[0]
    ceiling = [one.ceiling for one in felt]
    return {
        "ceiling_force": Interval(given.ceiling, min(ceiling), max(ceiling)),
        "floor_force": max(one.floor for one in felt),
        "overlap": max(one.overlap for one in felt) / radius,
        "speed": max(one.speed for one in felt),
        "impulse": given.impulse,
        "rate": given.rate,
        "mean_force": given.mean,
    }
