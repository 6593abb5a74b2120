# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One support amplitude: the height that is best in the worst case, and the response to be expected there.

The rule. Heights from the bare optimum downwards are rated by the largest amplitude over the corners of the box of
uncertainties, an irregular motion counted half as much again. The best of them, and up to two heights below it, are
then rated over all cases: both ways of opening, all approach paths of the given structure, the corners with the largest
and the least amplitude and efficiency by the main effects, and random structures inside the box. The least of these is
the design height; the interval is what the cases span there, and half a point for what lies between them.

Where the excitation drifts within a range of frequencies, all of that is at several of them: the height is the one that
is best at the worst frequency. What is expected is that of the given structure where it moves most.

The structure of today, without the damper, has its amplitude over the box in closed form (`bare_range`).
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from atpid_common.files import Document
from atpid_design.forces import forces
from atpid_design.problem import (
    Case,
    Problem,
    Uncertainty,
    case,
    cases,
    deviation,
    drawn_frequencies,
    modes_of,
    resonance,
)
from atpid_sim.maps import ALL_APPROACHES, FROM_CLOSED, Approach, Timing, best_height
from atpid_sim.maps.build import Best
from atpid_sim.maps.ratings import at_once, opened
from atpid_sim.modal import bare_amplitude, phasors
from atpid_sim.robust import Response, adverse, corners, inside, lowest_best
from atpid_sim.simulation.quantities import efficiency

#: Heights tried, as shares of the bare optimum's clearance: so many at a time, so far apart, down to the least.
_BATCH, _STEP, _LEAST = 8, 0.03, 0.2
#: Heights below the best that are rated over all cases as well.
_LOWER = 2
#: A longer window shows so much more of an irregular motion than the one used [-].
_IRREGULAR = 0.15
#: Forces of impacts grow with their speed to this power.
_SPEED_POWER = 1.2
#: What lies between the cases and between the amplitudes may be so much farther out: efficiency [-]; with the further
#: quantities of several modes twice as much.
_UNSEEN = 0.005
#: Random structures inside the box, and the seed that draws them.
_RANDOM, _SEED = 24, 1
#: Structures drawn for the amplitude of several modes without the damper, and their seed.
_BARE_DRAWN, _BARE_SEED = 512, 5
#: Heights are read between the amplitudes, as in a map: a well far above another has to be better by this share [-].
_HYSTERESIS = 0.15
#: Periods in which an amplitude is taken.
_WINDOW = 16.0
#: Relative tolerance of the run that shows the numerical error.
_FINE = 1e-8
#: An error of the height is looked for that costs so much of the reduction, among these shares of the clearance [-].
_COST, _OFF = 0.02, (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)


class Interval(NamedTuple):
    """What is expected of the given structure where it moves most, and the least and the largest over all cases."""

    expected: float
    low: float
    high: float


class FrequencyPoint(NamedTuple):
    """The given structure at one frequency of the excitation."""

    frequency: float  # [Hz]
    amplitude: float  # [m]
    bare: float  # without the damper [m]
    reduction: float  # [-]


@dataclass(frozen=True)
class Point:
    """The design at one support amplitude."""

    amplitude: float  # of the support [m] or the force [N]
    height: float  # of the ceiling [m]
    clearance: float  # height less the grain's diameter [m]
    frequency: float  # of the excitation where the given structure moves most [Hz]
    over_frequency: list[FrequencyPoint]
    efficiency: Interval  # against the closed damper [-]
    reduction: Interval  # against the structure without the damper [-]
    beam_amplitude: Interval  # [m]
    bare_amplitude: Interval  # without the damper [m]
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
    sound_power: float  # of the grain as a sphere in free air, given structure [W]
    acceleration: float  # of the closed damper over gravity, omega^2 X_0 / g; infinite without gravity [-]
    height_error: float  # that costs the given structure `_COST` of its reduction; at most a fifth of the clearance [m]
    structures: int  # cases that the intervals are taken over


@dataclass(frozen=True)
class Structures:
    """The given structure, the corners of the box and random structures inside, with one grain."""

    problem: Problem
    fraction: float
    at: Sequence[Sequence[Case]]  # for each frequency of the excitation: the given structure, then the corners
    random: Sequence[Case]

    @staticmethod
    def of(problem: Problem, fraction: float) -> "Structures":
        """Return the structures with a grain of a mass fraction [-]. Raises SceneError for an invalid value."""
        count = problem.quantities
        box, inner = np.vstack([np.zeros(count), corners(count)]), inside(_RANDOM, count, _SEED)
        at = [list(cases(problem, fraction, box, [f] * len(box))) for f in problem.frequencies]
        random = list(cases(problem, fraction, inner, drawn_frequencies(problem, _RANDOM, _SEED)))
        return Structures(problem, fraction, at, random)

    @property
    def every(self) -> list[Case]:
        """The given structure and the corners, one frequency after the other."""
        return [one for row in self.at for one in row]

    def worst(self, responses: Sequence[Response]) -> int:
        """Return the number of the frequency at which the given structure moves most, of the responses of `every`."""
        given = responses[: len(self.every) : len(self.at[0])]
        return max(range(len(given)), key=lambda k: given[k].amplitude)

    def bare(self, amplitude: float) -> Best:
        """Return the best height of the given structure, the largest of those at each frequency.

        Raises NumericalFailure.
        """
        limits = 2.0 * self.at[0][0].damper.system.radius, self.problem.max_height
        found = [best_height(row[0].damper, amplitude, _HYSTERESIS, limits, FROM_CLOSED) for row in self.at]
        return max(found, key=lambda one: one.height)


def response_of(one: Case, amplitude: float, height: float, approach: Approach = at_once) -> Response:
    """Return the response of a case to an identified amplitude and a commanded height [m]. Raises NumericalFailure."""
    damper, true = one.damper, one.amplitude(amplitude)
    settle = damper.settling()
    path = approach(damper, one.height(height), 0.5 * settle * damper.period)
    motion = damper.follow(true, path, Timing(settle, _WINDOW))
    reduced = efficiency(motion.amplitude, damper.closed_amplitude(true))
    return Response(motion.amplitude, reduced, motion.regular, one.bare(amplitude))


def rated_heights(structures: Structures, amplitude: float, best: Best, every: int = 1) -> dict[float, list[Response]]:
    """Return {height [m]: responses of `structures.every`}, from the bare optimum down.

    Heights are added until the best lies inside; every: 2 leaves out each second one. Raises NumericalFailure.
    """
    diameter = structures.at[0][0].damper.diameter
    clearance, share = best.height - diameter, 1.0
    rated: dict[float, list[Response]] = {}
    while share > _LEAST and (not rated or lowest_best(worst_ratings(rated)) == min(rated)):
        for k in range(0, _BATCH, every):
            height = diameter + clearance * (share - _STEP * k)
            rated[height] = [response_of(one, amplitude, height) for one in structures.every]
        share -= _STEP * _BATCH
    return rated


def worst_ratings(rated: dict[float, list[Response]]) -> dict[float, float]:
    """Return {height [m]: largest rating of its responses [m]}."""
    return {height: max(one.rating for one in responses) for height, responses in rated.items()}


def point(structures: Structures, amplitude: float) -> Point:
    """Return the design at a support amplitude [m]. Raises NumericalFailure."""
    best = structures.bare(amplitude)
    rated = rated_heights(structures, amplitude, best)
    good = lowest_best(worst_ratings(rated))
    lower = sorted((height for height in rated if height <= good), reverse=True)[: _LOWER + 1]
    full = {height: _all_responses(structures, amplitude, height, rated[height]) for height in lower}
    height = lowest_best(worst_ratings(full))
    return _described(structures, amplitude, height, full[height], best)


def _all_responses(
    structures: Structures, amplitude: float, height: float, known: Sequence[Response]
) -> list[Response]:
    """Return the responses of all cases at a height [m], first those of `structures.every`, which are known."""
    run: Callable[..., Response] = partial(response_of, amplitude=amplitude, height=height)
    box, found = corners(structures.problem.quantities), list(known)
    for number, (given, *others) in enumerate(structures.at):
        begin = number * (1 + len(others)) + 1
        own = known[begin : begin + len(others)]
        extreme = [adverse(box, np.array([getattr(one, name) for one in own])) for name in ("amplitude", "efficiency")]
        ends = np.array([side * e for e in extreme for side in (1, -1)])
        at = [structures.problem.frequencies[number]] * len(ends)
        found += [run(given, approach=approach) for approach in ALL_APPROACHES]
        found += [run(one, approach=opened) for one in others]
        found += [
            run(one, approach=approach)
            for one in cases(structures.problem, structures.fraction, ends, at)
            for approach in (at_once, opened)
        ]
    return [*found, *(run(one) for one in structures.random)]


def _described(structures: Structures, amplitude: float, height: float, responses: list[Response], best: Best) -> Point:
    problem, fraction, number = structures.problem, structures.fraction, structures.worst(responses)
    given, frequency = structures.at[number][0], problem.frequencies[number]
    damper, expected = given.damper, responses[number * len(structures.at[0])]
    fine = response_of(case(problem, fraction, rtol=_FINE, frequency=frequency), amplitude, height).amplitude
    error = abs(fine / expected.amplitude - 1.0)
    regular = all(one.regular for one in responses)
    wider, unseen = error + (0.0 if regular else _IRREGULAR), _UNSEEN * (2.0 if problem.further_modes else 1.0)
    gravity, omega = problem.gravity, 2.0 * np.pi * damper.frequency
    closed = damper.closed_amplitude(amplitude)
    amplitudes = [one.amplitude for one in responses]
    return Point(
        amplitude=amplitude,
        height=height,
        clearance=height - damper.diameter,
        frequency=damper.frequency,
        over_frequency=[
            FrequencyPoint(row[0].damper.frequency, one.amplitude, one.bare, one.reduction)
            for row, one in zip(structures.at, responses[:: len(structures.at[0])], strict=False)
        ],
        efficiency=_widened(expected.efficiency, [one.efficiency for one in responses], wider, unseen),
        reduction=_widened(expected.reduction, [one.reduction for one in responses], wider, unseen),
        beam_amplitude=Interval(
            expected.amplitude,
            max(min(amplitudes) * (1.0 - wider) - unseen * closed, 0.0),
            max(amplitudes) * (1.0 + wider) + unseen * closed,
        ),
        bare_amplitude=Interval(expected.bare, *bare_range(problem, fraction, amplitude)),
        closed_amplitude=closed,
        best_height=best.height,
        best_efficiency=best.efficiency,
        regular=regular,
        numerical_error=error,
        height_error=_height_error(given, amplitude, height, expected),
        structures=len(responses),
        acceleration=omega**2 * closed / gravity if gravity > 0.0 else float("inf"),
        **_forces(structures, amplitude, height, 1.0 if regular else (1.0 + _IRREGULAR) ** _SPEED_POWER),
    )


def _widened(expected: float, seen: Sequence[float], wider: float, unseen: float) -> Interval:
    """Return the interval of a share of an amplitude that is taken off, where the rest may be off by a share."""
    low, high = min(seen), max(seen)
    return Interval(expected, low - wider * (1.0 - low) - unseen, min(high + wider * (1.0 - high) + unseen, 1.0))


def _height_error(given: Case, amplitude: float, height: float, expected: Response) -> float:
    """Return the least error of the height [m], to either side, that costs `_COST` of the reduction."""
    clearance, allowed = height - given.damper.diameter, expected.reduction - _COST
    found = _OFF[-1] * clearance
    for side in (-1.0, 1.0):
        inner, kept = 0.0, expected.reduction
        for share in _OFF:
            reduction = response_of(given, amplitude, height + side * share * clearance).reduction
            if reduction < allowed:
                crossed = inner + (share - inner) * (kept - allowed) / (kept - reduction)
                found = min(found, crossed * clearance)
                break
            inner, kept = share, reduction
    return found


def _forces(structures: Structures, amplitude: float, height: float, longer: float) -> Document:
    """Return what the walls bear, at the frequency at which the given structure's ceiling bears most.

    longer: by which factor a longer window would show larger forces.
    """
    given = [forces(row[0], amplitude, height) for row in structures.at]
    number = max(range(len(given)), key=lambda k: given[k].ceiling)
    own = structures.at[number]
    found = [given[number], *(forces(one, amplitude, height) for one in own[1:])]
    hardest = adverse(corners(structures.problem.quantities), np.array([one.ceiling for one in found[1:]]))
    at = [structures.problem.frequencies[number]] * 2
    extremes = cases(structures.problem, structures.fraction, np.array([hardest, -hardest]), at)
    found += [*given, *(forces(one, amplitude, height) for one in extremes)]
    ceiling, floor = ([getattr(one, name) for one in found] for name in ("ceiling", "floor"))
    return {
        "ceiling_force": Interval(found[0].ceiling, min(ceiling), max(ceiling) * longer),
        "floor_force": max(floor) * longer,
        "overlap": max(one.overlap for one in found) / own[0].damper.system.radius,
        "speed": max(one.speed for one in found),
        "impulse": found[0].impulse,
        "rate": found[0].rate,
        "mean_force": found[0].mean,
        "sound_power": found[0].sound_power,
    }


def bare_range(problem: Problem, fraction: float, amplitude: float) -> tuple[float, float]:
    """Return the least and largest amplitude [m] without the damper within the box, for an identified amplitude [m].

    Of one mass on its support it depends on frequency ratio and damping ratio only; all between the ends is looked at.
    Of several modes, and under a force, it is that of drawn structures, most of them at corners of the box.
    """
    u = problem.uncertainty
    if problem.is_modal:
        low, high = _bare_over_drive(problem, fraction)
        return amplitude * low, amplitude * high
    resonant = resonance(problem, fraction)
    low, high = problem.excitation_frequency or (resonant, resonant)
    # the grain's mass is known, so an error of the beam's moves the resonance
    moved = 0.5 * fraction * u.mass if problem.excitation_frequency is None else u.frequency
    ratios = np.linspace(low * (1.0 - u.detuning) / (1.0 + moved), high * (1.0 + u.detuning) / (1.0 - moved), 501)
    ratios = np.append(ratios / problem.frequency, np.clip(1.0, *ratios[[0, -1]] / problem.frequency))
    found = [
        bare_amplitude(1.0, 1.0, 2.0 * problem.damping * (1.0 + side * u.damping), amplitude, ratio / (2.0 * math.pi))
        for ratio in ratios
        for side in (-1.0, 1.0)
    ]
    return min(found) * (1.0 - u.amplitude), max(found) * (1.0 + u.amplitude)


@functools.lru_cache(maxsize=64)
def _bare_over_drive(problem: Problem, fraction: float) -> tuple[float, float]:
    """Return the least and largest amplitude without the damper over that of the drive, of several modes [m/m, m/N]."""
    points = inside(_BARE_DRAWN, problem.quantities, _BARE_SEED)
    names = list(Uncertainty.model_fields)
    # masses and dampings at their ends; frequencies anywhere, since a resonance may lie between
    between = [k for k, name in enumerate(names) if name in ("frequency", "detuning")]
    between += range(len(names) + 1, problem.quantities, 3)
    ends = np.sign(points)
    ends[:, between] = points[:, between]
    found = []
    for point, drawn in zip(ends, drawn_frequencies(problem, len(ends), _BARE_SEED), strict=True):
        off = deviation(problem, point)
        modes = modes_of(problem, fraction, off)
        assert modes is not None
        at = (modes.joined.frequencies[0] if drawn is None else drawn) * (1.0 + off.detuning)
        found.append((1.0 + off.amplitude) * abs(phasors(modes.free, at).sum()))
    return float(min(found)), float(max(found))
