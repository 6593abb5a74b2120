# SPDX-License-Identifier: Apache-2.0
"""The grain: masses tried, what each promises, and which is chosen."""

from collections.abc import Sequence
from dataclasses import dataclass

from atpid_control.design.forces import forces
from atpid_control.design.problem import Problem, grain_mass, grain_radius
from atpid_control.design.promise import Answer, Interval, Structures, lowest_best, rated_heights
from atpid_sim.outcome import NumericalFailure

#: Mass fractions tried, up to the largest allowed and that itself [-].
FRACTIONS = (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
#: Without a target the smallest grain is taken that keeps an efficiency this close to that of the best [-].
AS_GOOD = 0.03


@dataclass(frozen=True)
class Trial:
    """A grain at one support amplitude, over the corners of the box; or why it cannot be computed."""

    fraction: float
    amplitude: float  # [m]
    height: float = 0.0  # [m]
    answers: Sequence[Answer] = ()
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


def fractions(problem: Problem) -> list[float]:
    """Return the mass fractions that are tried, rising."""
    return [*(f for f in FRACTIONS if f < problem.max_mass_fraction), problem.max_mass_fraction]


def trial(structures: Structures, amplitude: float) -> Trial:
    """Return what a grain does at a support amplitude [m]; where a run fails, with the reason."""
    fraction = structures.fraction
    try:
        rated = rated_heights(structures, amplitude, structures.bare(amplitude), every=2)
        height = lowest_best(rated)
        felt = forces(structures.given, amplitude, height)
    except NumericalFailure as error:
        return Trial(fraction, amplitude, failure=str(error))
    return Trial(fraction, amplitude, height, rated[height], felt.ceiling)


def candidate(problem: Problem, trials: Sequence[Trial]) -> Candidate:
    """Return a grain over the amplitudes of its trials."""
    fraction = trials[0].fraction
    about = fraction, grain_mass(problem, fraction), grain_radius(problem, fraction)
    failed = [one for one in trials if one.failure]
    if failed:
        return Candidate(*about, Interval(0.0, 0.0, 0.0), (0.0, 0.0), 0.0, failed[0].failure)
    every = [answer.efficiency for one in trials for answer in one.answers]
    heights = [one.height for one in trials]
    return Candidate(
        *about,
        Interval(min(one.answers[0].efficiency for one in trials), min(every), max(every)),
        (min(heights), max(heights)),
        max(one.ceiling_force for one in trials),
    )


def preferred(problem: Problem, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the grains in the order in which they are to be taken.

    With a target: the smallest that keeps it, then the heavier ones; last the one that keeps most. Without one: the
    smallest that keeps as much as the best, to `AS_GOOD`. Raises NumericalFailure where none can be computed.
    """
    sound = [one for one in candidates if not one.failure]
    if not sound:
        raise NumericalFailure(
            f"no grain can be computed for these amplitudes: {candidates[0].failure}; give a stiffer grain "
            "(--young-modulus) or smaller --amplitudes"
        )
    best = max(sound, key=lambda one: one.efficiency.low)
    target = problem.target_reduction
    if target is None:
        return [next(one for one in sound if one.efficiency.low >= best.efficiency.low - AS_GOOD)]
    kept = [one for one in sound if one.efficiency.low >= target]
    return [*(one for one in kept if one is not best), best]
