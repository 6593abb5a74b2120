# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The grain: masses tried, what each promises, and which is chosen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from atpid_design.forces import forces
from atpid_design.problem import Problem, grain_mass, grain_radius
from atpid_design.worst_case import Interval, Structures, bare_range, rated_heights, worst_ratings
from atpid_sim.outcome import NumericalFailure
from atpid_sim.robust import Response, lowest_best

#: Mass fractions tried, up to the largest allowed and that itself [-].
_FRACTIONS = (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
#: Without a target the smallest grain is taken that keeps an efficiency this close to that of the best [-].
_AS_GOOD = 0.03

_NONE = Interval(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Trial:
    """A grain at one support amplitude, over the corners of the box; or why it cannot be computed."""

    fraction: float
    amplitude: float  # [m]
    height: float = 0.0  # [m]
    responses: Sequence[Response] = ()  # that of the given structure where it moves most is the first
    ceiling_force: float = 0.0  # given structure [N]
    failure: str = ""


@dataclass(frozen=True)
class Candidate:
    """A grain over the whole range of amplitudes."""

    mass_fraction: float
    grain_mass: float  # [kg]
    radius: float  # [m]
    efficiency: Interval  # least expected, least and largest of all amplitudes and corners [-]
    heights: tuple[float, float]  # least and largest [m]
    ceiling_force: float  # largest of the given structure [N]
    failure: str = ""  # why it cannot be computed
    reduction: Interval = _NONE  # likewise [-]
    largest: float = 0.0  # 1 - largest amplitude over the largest of today, of all frequencies and corners; least [-]

    def kept(self, problem: Problem) -> float:
        """Return what grains are compared by [-].

        At given frequencies that is what is left of the largest amplitude: where the structure hardly moves today, a
        reduction is of no use, and worse is of little harm.
        """
        if problem.target_reduction is None and problem.excitation_frequency is not None:
            return self.largest
        return self.efficiency.low if problem.aim == "efficiency" else self.reduction.low


def meets(problem: Problem, efficiency: float, reduction: float) -> bool:
    """Whether a least efficiency and a least reduction [-] keep the targets that are given."""
    least = problem.target_efficiency or -math.inf, problem.target_reduction or -math.inf
    return efficiency >= least[0] and reduction >= least[1]


def fractions(problem: Problem) -> list[float]:
    """Return the mass fractions that are tried, rising."""
    return [*(f for f in _FRACTIONS if f < problem.max_mass_fraction), problem.max_mass_fraction]


def trial(structures: Structures, amplitude: float) -> Trial:
    """Return what a grain does at a support amplitude [m]; where a run fails, with the reason."""
    fraction = structures.fraction
    try:
        rated = rated_heights(structures, amplitude, structures.bare(amplitude), every=2)
        height = lowest_best(worst_ratings(rated))
        worst = structures.worst(rated[height])
        contact_forces = forces(structures.at[worst][0], amplitude, height)
    except NumericalFailure as error:
        return Trial(fraction, amplitude, failure=str(error))
    first = rated[height][worst * len(structures.at[0])]
    return Trial(fraction, amplitude, height, [first, *rated[height]], contact_forces.ceiling)


def candidate(problem: Problem, trials: Sequence[Trial]) -> Candidate:
    """Return a grain over the amplitudes of its trials."""
    fraction = trials[0].fraction
    about = fraction, grain_mass(problem, fraction), grain_radius(problem, fraction)
    failed = [one for one in trials if one.failure]
    if failed:
        return Candidate(*about, _NONE, (0.0, 0.0), 0.0, failed[0].failure)
    efficiency, reduction = (
        Interval(
            min(getattr(one.responses[0], name) for one in trials),
            *(side(getattr(response, name) for one in trials for response in one.responses) for side in (min, max)),
        )
        for name in ("efficiency", "reduction")
    )
    heights = [one.height for one in trials]
    return Candidate(
        *about,
        efficiency,
        (min(heights), max(heights)),
        max(one.ceiling_force for one in trials),
        reduction=reduction,
        largest=min(
            1.0 - max(r.amplitude for r in one.responses) / bare_range(problem, fraction, one.amplitude)[1]
            for one in trials
        ),
    )


def preferred(problem: Problem, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the grains in the order in which they are to be taken.

    With a target: the smallest that keeps it, then the heavier ones; last the one that keeps most. Without one: the
    smallest that keeps as much as the best, to `_AS_GOOD`. Raises NumericalFailure where none can be computed.
    """
    sound = [one for one in candidates if not one.failure]
    if not sound:
        raise NumericalFailure(
            f"no grain can be computed for these amplitudes: {candidates[0].failure}; lengths are in metres, 1.2 mm is "
            "0.0012; else give a stiffer grain (--young-modulus) or smaller --amplitudes"
        )
    best = max(sound, key=lambda one: one.kept(problem))
    if problem.target_efficiency is None and problem.target_reduction is None:
        return [next(one for one in sound if one.kept(problem) >= best.kept(problem) - _AS_GOOD)]
    kept = [one for one in sound if meets(problem, one.efficiency.low, one.reduction.low)]
    return [*(one for one in kept if one is not best), best]
