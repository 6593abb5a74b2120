# SPDX-License-Identifier: Apache-2.0
"""The steady motion of a scene without waiting for it: the transient is followed until it contracts, then solved for.

Which motion a system ends in depends on how it got there, so the run is followed from its start, with contacts from a
table. Once the distance between passages of the section shrinks regularly, the motion it shrinks to is a fixed point of
the return map of period one or two. Newton's method finds it there at the fidelity asked for, with a derivative from
the tabulated contacts, which differs from the true one by far less than Newton's steps need. The last of these steps is
the period that verifies the motion.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine.columns import END
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.periodic.return_map import Conditions, Orbit, ReturnMap, passage
from atpid_sim.periodic.solve import size_of
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.simulation.excitation import amplitude_points, frequency_points
from atpid_sim.simulation.fidelity import choose, complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation, drive_table, rtol_of
from atpid_sim.system import Array

#: Periods before contraction is looked for, and how many distances in a row have to shrink.
_SETTLED, _REGULAR = 4, 3
#: Distance of two passages, relative to the motion's size, below which a fixed point is looked for; factor by which
#: distances have to shrink at least.
_NEAR, _SHRINKING = 0.03, 0.98
#: Distance of successive passages over the one still to go, up to which they belong to one of period one.
_ALIKE = 2.5
#: Width of the differences for the derivative, relative to the motion's size; tolerance of the run that is followed.
_WIDTH, _FOLLOWING = 1e-5, 1e-4
#: Periods followed in one call.
_CHUNK = 7
#: Step beyond which the derivative is taken again.
_CURVED = 1e-2
#: Step from which on the motion is the one of the tabulated contacts.
_COARSE = 1e-4
#: Newton's steps at most, and how far they may lead, in the distances that are left to go at the rate of contraction.
_STEPS, _FARTHEST = 12, 5.0
#: Share of the tolerance with which the periods of the solution are integrated.
_SHARE = 0.1
_IDENTITY = np.eye(4)
#: Least multiplier of which a logarithm is taken.
_LEAST = 1e-12


class SteadyEnding(Enum):
    """How a search for a steady motion ended."""

    FOUND = "the steady motion was found, and one more period verified it"
    CHANGING = "excitation or ceiling change until the end: there is no steady motion"
    IRREGULAR = "the transient does not contract regularly before the scene ends: run it as it is"
    IN_CONTACT = "the grain never flies freely, so that no section can be taken: run the scene as it is"
    NOT_CONVERGED = "Newton's method did not converge to a motion near the transient: run the scene as it is"


@dataclass(frozen=True)
class SteadyState:
    """A stable periodic motion that a scene ends in."""

    amplitude: float  # half peak-to-peak of the beam [m]
    error_estimate: float  # relative, of the amplitude: what is left of Newton's steps, tolerance, and model error
    periods: int  # of the support after which it repeats itself
    multipliers: NDArray[np.complex128]  # (4,), the largest modulus first
    followed: float  # how much of the scene was followed [s]
    section: Array  # (4,), see `periodic.return_map`
    phase: float  # of the section, as a share of a period
    impacts: Array  # (k, 3): time after the section [s], wall (+1 floor, -1 ceiling), closing speed [m/s]
    fidelity: str

    @property
    def stability_margin(self) -> float:
        """Distance to instability, 1 - largest modulus of the multipliers [-]."""
        return 1.0 - float(abs(self.multipliers[0]))

    @property
    def settling_periods(self) -> float:
        """Periods of the support in which a small disturbance falls to 1/e in the end."""
        return -self.periods / math.log(max(float(abs(self.multipliers[0])), _LEAST))


@dataclass(frozen=True)
class SteadySearch:
    """How a search ended, and the steady motion where one was found."""

    ending: SteadyEnding
    state: SteadyState | None = None


@dataclass(frozen=True)
class _Approach:
    """A transient that contracts: its last section state, and how far apart its passages are."""

    once: ReturnMap  # of the run that was followed, over one period
    periods: int
    section: Array
    scale: Array
    time: float
    remaining: float  # distance still to go at the rate of contraction, relative


def steady_state(scene: Scene, fidelity: str = "auto", rtol: float | None = None) -> SteadySearch:
    """Return the steady motion that a scene ends in, as if its last excitation and ceiling went on for ever.

    fidelity, rtol: of the solution, as in `simulate`. A search that finds none is a result with its reason. Raises
    NumericalFailure where the transient does not run as it should, SceneError where a controller moves the ceiling,
    ValueError for an unknown fidelity.
    """
    scene.require_prescribed_ceiling()
    choice = choose(scene, fidelity)
    conditions = _conditions(scene)
    if conditions is None:
        return SteadySearch(SteadyEnding.CHANGING)
    asked = rtol_of(scene) if rtol is None else rtol
    fine = Integration(scene, choice.fidelity, max(1e-12, _SHARE * asked))
    quick = Integration(scene, "finite" if complete_fidelity(scene) == "soft" else "impact", _FOLLOWING)
    approach = _follow(scene, quick, conditions)
    if not isinstance(approach, _Approach):
        return SteadySearch(approach)
    return _solve(approach, quick, fine, conditions, choice.model_error + asked)


def _conditions(scene: Scene) -> Conditions | None:
    """Return what does not change any more after the last kink of the scene; None where something does."""
    if not isinstance(scene.excitation, HarmonicExcitation) or _still_from(scene) >= scene.duration:
        return None
    return Conditions(amplitude_points(scene)[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])


def _still_from(scene: Scene) -> float:
    """Return the time from which on excitation and ceiling are what they are at the end [s]."""
    last = 0.0
    for points in (amplitude_points(scene), frequency_points(scene), scene.ceiling.heights):
        changes = [k for k in range(1, len(points)) if points[k][1] != points[k - 1][1]]
        last = max(last, float(points[changes[-1]][0]) if changes else 0.0)
    return last


def _follow(scene: Scene, quick: Integration, conditions: Conditions) -> _Approach | SteadyEnding:
    """Follow the scene until its passages of a section draw together regularly."""
    period = 1.0 / conditions.frequency
    begin = period * (math.ceil(_still_from(scene) / period) + _SETTLED)
    if begin >= scene.duration:
        return SteadyEnding.IRREGULAR
    state = quick.initial_state()
    table = drive_table(scene, (begin - period, begin))
    _advance(quick, state, table[table[:, END] <= begin], Observation((begin - period, begin)))
    try:
        phase, section = passage(quick, conditions, state, 0.0)
    except NumericalFailure:
        return SteadyEnding.IN_CONTACT
    once = ReturnMap(quick, conditions, phase)
    scale = size_of(state.amplitude, conditions)
    apart_by = {1: [math.inf], 2: [math.inf]}  # distances of passages one and two periods apart
    followed = _passages(once, section, scale, int((scene.duration - begin) / period) - 1)
    for count, (section, *distances) in enumerate(followed, 1):
        for apart, distance in zip(apart_by.values(), distances, strict=True):
            apart.append(distance)
        for periods, apart in apart_by.items():
            if apart[-1] > _NEAR or len(apart) <= _REGULAR + periods:
                continue
            rate = max(b / a if a > 0.0 else 0.0 for a, b in pairwise(apart[-_REGULAR - 1 :]))
            if rate <= _SHRINKING:
                remaining = apart[-1] / (1.0 - rate)
                # a motion of period one draws together at every second passage as well, and there more evenly
                repeats = 1 if apart_by[1][-1] <= _ALIKE * remaining else periods
                return _Approach(once, repeats, section, scale, begin + (count + 1) * period, remaining)
    return SteadyEnding.IRREGULAR


def _passages(once: ReturnMap, section: Array, scale: Array, count: int) -> Iterator[tuple[Array, float, float]]:
    """Yield the next `count` section states (4,) and how far each is from the last and the last but one, relative to
    the motion's size; ends early where a run fails. A chunk is one call of compiled code.
    """
    known = section[None]
    while count > 0:
        wanted = min(count, _CHUNK)
        chunk = np.concatenate([known, once.passages(known[-1], wanted)])
        one = (np.abs(chunk[1:] - chunk[:-1]) / scale).max(axis=1).tolist()
        two = (np.abs(chunk[2:] - chunk[:-2]) / scale).max(axis=1).tolist()
        if len(known) == 1:
            two = [math.inf, *two][: len(one)]
        yield from zip(chunk[len(known) :], one[len(known) - 1 :], two, strict=True)
        if len(chunk) < wanted + len(known):
            return
        known, count = chunk[-2:], count - wanted


def _size(step: Array, scale: Array) -> float:
    """Return the largest part of a step (4,), relative to the motion's size."""
    return float(max(map(abs, (step / scale).tolist())))


def _solve(
    approach: _Approach, quick: Integration, fine: Integration, conditions: Conditions, known: float
) -> SteadySearch:
    """Return the fixed point near a transient that contracts; known: relative error that steps do not remove."""
    coarse = approach.once
    if approach.periods > 1:
        coarse = ReturnMap(quick, conditions, approach.once.phase, approach.periods)
    exact = coarse.by(fine)
    scale, section, left = approach.scale, approach.section, math.inf
    slope: Array | None = None
    inverse: NDArray[np.floating[Any]] = _IDENTITY
    try:
        for count in range(_STEPS):
            # first the motion of the tabulated contacts, next to the one that is asked for
            near, orbit, after = count >= _STEPS // 2 or left <= _COARSE, None, None
            if slope is None or left > _CURVED:  # the derivative where the last step has led
                after, slope = coarse.forward_differences(section, _WIDTH * scale)
                inverse = np.linalg.inv(_IDENTITY - slope)
            if near:
                after, orbit = exact.passed(section)
            elif after is None:
                after = coarse(section)
            step = inverse @ (after - section)
            left = _size(step, scale)
            if orbit is not None and left <= known:
                return _described(approach, fine, orbit, section, slope, left + known)
            section = section + step
            if _size(section - approach.section, scale) > _FARTHEST * approach.remaining + known:
                break
    except (NumericalFailure, np.linalg.LinAlgError):
        pass
    return SteadySearch(SteadyEnding.NOT_CONVERGED)


def _described(
    approach: _Approach, fine: Integration, orbit: Orbit, section: Array, slope: Array, error: float
) -> SteadySearch:
    multipliers = np.linalg.eigvals(slope).astype(complex)
    multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
    if abs(multipliers[0]) >= 1.0:
        return SteadySearch(SteadyEnding.NOT_CONVERGED)
    found = SteadyState(
        orbit.amplitude, error, approach.periods, multipliers, approach.time, section, approach.once.phase,
        orbit.impacts, fine.fidelity,
    )  # fmt: skip
    return SteadySearch(SteadyEnding.FOUND, found)


def _advance(integration: Integration, state: State, table: Array, observation: Observation) -> None:
    outcome = integration.advance(state, table, observation)
    if outcome != Outcome.DONE:
        raise NumericalFailure(outcome.sentence)
