# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole design: the grain, heights over the amplitudes, the promise with its check, the motor."""

import itertools
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from atpid_common.files import Document
from atpid_common.output import finite
from atpid_design import grain_choice
from atpid_design.check import Check, drawn, widened
from atpid_design.grain_choice import Candidate
from atpid_design.limits import warnings_of
from atpid_design.motor import Motor, motor
from atpid_design.problem import Problem, modes_of, resonance
from atpid_design.tuned_mass import Comparison, compare
from atpid_design.worst_case import Interval, Point, Structures, point, response_of
from atpid_sim.modal import bare_amplitude, phasors
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array

#: Support amplitudes of the promise, evenly spaced in the logarithm, and of the trade between grains.
_AMPLITUDES, _FOR_TRADE = 7, 3
#: The height map reaches from this share of the least amplitude to this one of the largest, so that the loop has a
#: height on the way there and where an estimate lies beyond the end [-].
_BELOW, _ABOVE = 0.25, 1.1
#: Heights of the picture of the cliff, from and to these shares of the bare optimum's clearance.
_LANDSCAPE, _FROM, _TO = 30, 0.45, 1.35
#: Grains tried in turn until the promise meets the target; the last is the one that keeps most.
_TRIES = 3
S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class Landscape:
    """The beam's amplitude over the height, at one support amplitude, where the given structure moves most."""

    amplitude: float  # of the support [m] or the force [N]
    heights: Array  # (n,) [m]
    given: Array  # (n,) over that of the closed damper [-]
    cases: Array  # (n, 16) the same of the corners of the box [-]


@dataclass(frozen=True)
class Design:
    """A damper for a structure, and what it promises."""

    problem: Problem
    candidates: list[Candidate]
    mass_fraction: float
    grain_mass: float  # [kg]
    radius: float  # [m]
    resonance: float  # of beam and grain as one mass [Hz]
    points: list[Point]  # at the amplitudes promised, rising
    beyond: list[Point]  # outside of them, for the height map only
    motor: Motor
    check: Check
    landscape: Landscape
    tuned_mass: Comparison
    warnings: list[str]
    wall_s: float  # [s]

    @property
    def efficiency(self) -> tuple[float, float]:
        """Least and largest promised efficiency over all amplitudes [-]."""
        return min(p.efficiency.low for p in self.points), max(p.efficiency.high for p in self.points)

    @property
    def reduction(self) -> tuple[float, float]:
        """Least and largest promised reduction over all amplitudes [-]."""
        return min(p.reduction.low for p in self.points), max(p.reduction.high for p in self.points)

    @property
    def frequencies(self) -> tuple[float, float]:
        """Least and largest frequency of the excitation [Hz]."""
        return self.problem.excitation_frequency or (self.resonance, self.resonance)

    @property
    def heights(self) -> tuple[float, float]:
        """Least and largest height over all amplitudes [m]."""
        heights = [one.height for one in self.points]
        return min(heights), max(heights)

    @property
    def bare_resonance_amplitude(self) -> float:
        """Amplitude at the largest of the support without the damper, at the resonance the structure then has [m]."""
        p = self.problem
        if (modes := modes_of(p, self.mass_fraction)) is not None:
            return float(p.amplitudes[1] * abs(phasors(modes.free, p.frequency).sum()))
        return bare_amplitude(1.0, 1.0, 2.0 * p.damping, p.amplitudes[1], 1.0 / (2.0 * math.pi))

    def to_json(self) -> Document:
        """Return plain numbers and text by the names of the fields, SI; not finite: None."""
        plain: Document = _plain(self)
        for one in (*plain["points"], *plain["beyond"]):
            omega = 2.0 * math.pi * one["frequency"]
            one["beam_acceleration"] = {name: omega**2 * value for name, value in one["beam_amplitude"].items()}
        for name in ("efficiency", "reduction"):
            plain[name] = dict(zip(("low", "high"), getattr(self, name), strict=True))
        for name in ("frequencies", "bare_resonance_amplitude", "heights"):
            plain[name] = getattr(self, name)
        return dict(finite(plain))


def _plain(value: Any) -> Any:
    """Return dataclasses, models and tuples with names as dicts of their fields, arrays as lists."""
    if isinstance(value, BaseModel):
        return value.model_dump()
    if isinstance(value, np.ndarray):
        return value.tolist()
    named = value._asdict() if hasattr(value, "_asdict") else vars(value) if is_dataclass(value) else None
    if named is not None:
        return {name: _plain(one) for name, one in named.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def steps_of(problem: Problem) -> int:
    """Return how many steps of progress a design takes, where the first grain meets the target."""
    return _FOR_TRADE * len(grain_choice.fractions(problem)) + (_AMPLITUDES + 2) + (_AMPLITUDES - 1) + _LANDSCAPE


def design(problem: Problem, progress: Callable[[int], None] = lambda _: None) -> Design:
    """Return the design for a problem; `progress` is called with the number of steps done.

    Raises NumericalFailure where no grain can be computed, and SceneError for an invalid value.
    """
    begun, steps = time.perf_counter(), itertools.count(1)

    def count() -> None:
        progress(next(steps))

    candidates = _candidates(problem, count)
    structures, points, found = _chosen(problem, grain_choice.preferred(problem, candidates), count)
    fraction = structures.fraction
    drive = motor(problem, fraction, points)
    chosen = next(one for one in candidates if one.mass_fraction == fraction)
    return Design(
        problem=problem,
        candidates=candidates,
        mass_fraction=fraction,
        grain_mass=chosen.grain_mass,
        radius=chosen.radius,
        resonance=resonance(problem, fraction),
        points=points,
        beyond=_beyond(structures, count),
        motor=drive,
        check=found,
        landscape=_landscape(structures, points[len(points) // 2], count),
        tuned_mass=compare(problem, fraction, points),
        warnings=warnings_of(problem, fraction, points, drive, found),
        wall_s=time.perf_counter() - begun,
    )


#: Structures, points at the amplitudes, check.
Promised = tuple[Structures, list[Point], Check]


def _chosen(problem: Problem, order: Sequence[Candidate], count: Callable[[], None]) -> Promised:
    """Return the promise of the first grain that keeps the target at every amplitude, else of the one that keeps most.

    At most `_TRIES` are tried: the first ones and the last.
    """
    made = list[Promised]()
    for one in [*order[: _TRIES - 1], *order[_TRIES - 1 :][-1:]]:
        made.append(promised(problem, one.mass_fraction, count))
        if grain_choice.meets(problem, _least(made[-1], "efficiency"), _least(made[-1], "reduction")):
            return made[-1]
    return max(made, key=lambda one: _least(one, problem.aim))


def _least(made: Promised, name: str) -> float:
    intervals: list[Interval] = [getattr(one, name) for one in made[1]]
    return min(one.low for one in intervals)


def _candidates(problem: Problem, count: Callable[[], None]) -> list[Candidate]:
    structures = {fraction: Structures.of(problem, fraction) for fraction in grain_choice.fractions(problem)}
    amplitudes = [float(a) for a in np.geomspace(*problem.amplitudes, _FOR_TRADE)]
    jobs = [(fraction, amplitude) for fraction in structures for amplitude in amplitudes]
    trials = _in_order(lambda job: grain_choice.trial(structures[job[0]], job[1]), jobs, count)
    begins = range(0, len(trials), _FOR_TRADE)
    return [grain_choice.candidate(problem, trials[begin : begin + _FOR_TRADE]) for begin in begins]


def promised(
    problem: Problem, fraction: float, count: Callable[[], None] = lambda: None, amplitudes: int = _AMPLITUDES
) -> Promised:
    """Return what a grain of a mass fraction [-] promises at so many amplitudes, at least two, checked between them.

    `count` is called after each step. Raises NumericalFailure.
    """
    structures = Structures.of(problem, fraction)
    low, high = problem.amplitudes
    at = [low, *map(float, np.geomspace(low, high, amplitudes)[1:-1]), high]
    points = _in_order(lambda amplitude: point(structures, amplitude), at, count)
    places = range(amplitudes - 1)
    responses = _in_order(lambda place: drawn(problem, fraction, points, place), places, count)
    return structures, *widened(points, responses)


def _beyond(structures: Structures, count: Callable[[], None]) -> list[Point]:
    """Return the points below and above the amplitudes, for the height map; without one that cannot be computed."""

    def found(amplitude: float) -> Point | None:
        with suppress(NumericalFailure):
            return point(structures, amplitude)
        return None

    low, high = structures.problem.amplitudes
    return [one for one in _in_order(found, [_BELOW * low, _ABOVE * high], count) if one is not None]


def _in_order(work: Callable[[S], T], jobs: Sequence[S], count: Callable[[], None]) -> list[T]:
    """Return the results in the order of the jobs, computed on all cores."""
    results = {}
    for job, result in on_all_cores(work, jobs):
        results[job] = result
        count()
    return [results[job] for job in jobs]


def _landscape(structures: Structures, middle: Point, count: Callable[[], None]) -> Landscape:
    every = min(structures.at, key=lambda row: abs(row[0].damper.frequency - middle.frequency))
    damper = every[0].damper
    clearance = middle.best_height - damper.diameter
    heights = [damper.diameter + clearance * float(share) for share in np.linspace(_FROM, _TO, _LANDSCAPE)]

    def left(height: float) -> list[float]:
        try:
            return [1.0 - response_of(one, middle.amplitude, height).efficiency for one in every]
        except NumericalFailure:
            return [math.nan] * len(every)

    rows: Array = np.array(_in_order(left, heights, count))
    return Landscape(middle.amplitude, np.array(heights), rows[:, 0], rows[:, 1:])
