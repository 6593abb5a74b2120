# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steady motion of a scene without waiting for it: the transient is followed until it contracts, then solved for.

Which motion a system ends in depends on how it got there, so the run is followed from its start, with contacts from a
table (`engine.settling_run`). Once the distance between passages of the section shrinks regularly, the motion it
shrinks to is a fixed point of the return map of period one or two. Newton's method finds it there at the fidelity asked
for, with a derivative from the tabulated contacts, which differs from the true one by far less than Newton's steps
need. The last of these steps is the period that verifies the motion. Where this short way finds none, or the transient
is no plain approach, the scene is run on at the fidelity asked for (`periodic.run_on`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.settling_run import REGULAR, settle
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.periodic.return_map import Conditions, Orbit, ReturnMap
from atpid_sim.periodic.run_on import next_period, rows_until, run_on
from atpid_sim.periodic.solve import (
    SteadyEnding,
    SteadySearch,
    SteadyState,
    arrives,
    least_size,
    multipliers_at,
    size_of,
)
from atpid_sim.results import named_impacts
from atpid_sim.scene import Scene
from atpid_sim.simulation.excitation import frequency_points
from atpid_sim.simulation.fidelity import choose, complete_fidelity
from atpid_sim.simulation.integration import Integration, rtol_of
from atpid_sim.system import Array

#: Periods before contraction is looked for; in the last of them the section is chosen.
_SETTLED = 4


@dataclass(frozen=True)
class Approach:
    """A transient that contracts: its passages of a section, and how far it still has to go."""

    once: ReturnMap  # of the run that was followed, over one period
    periods: int
    passages: Array  # section states (k, n), `periods` apart
    scale: Array  # size of the motion (n,)
    time: float
    remaining: float  # distance still to go at the rate of contraction, relative
    growth: float  # of the distance between passages on the way, wherever they drew apart again


def still_from(scene: Scene) -> float:
    """Return the time from which on excitation and ceiling are what they are at the end [s]."""
    last = 0.0
    for points in (scene.excitation.amplitude_points, frequency_points(scene), scene.ceiling.heights):
        changes = [k for k in range(1, len(points)) if points[k][1] != points[k - 1][1]]
        last = max(last, float(points[changes[-1]][0]) if changes else 0.0)
    return last


def follow(scene: Scene, quick: Integration, conditions: Conditions, still: float) -> Approach | None:
    """Follow the scene until its passages of a section draw together regularly; None where they do not.

    still: when its last kink is [s].
    """
    period = 1.0 / conditions.frequency
    begin = period * (math.ceil(still / period) + _SETTLED - 1)
    most = int((scene.duration - begin) / period)
    if most < 1:
        return None
    rows = rows_until(scene, begin)
    state, sections = quick.initial_state().without_ledger(), np.empty((most, len(quick.sections.places)))
    table = next_period(rows[-1], period)
    sizes, least = quick.sizes(conditions.frequency), least_size(quick, conditions)
    given = quick.kernel_inputs, rows, table, state.y, state.n, quick.sections, sizes, least, quick.step_limit
    outcome, ending, passed, amplitude, count, periods, remaining = settle(*given, sections)
    if outcome != Outcome.DONE or ending != REGULAR:
        return None
    once = ReturnMap(quick, conditions, float(table[0, columns.PHASE]) / (2.0 * math.pi) % 1.0)
    passages, time = sections[:count][::-periods][::-1], begin + passed * period
    scale = size_of(quick, amplitude, conditions)
    # the distance from passage to passage is a disturbance, too: what it grew by on the way others have grown by
    moves = np.abs(np.diff(passages / scale, axis=0)).max(axis=1)
    growth = float(np.prod(np.maximum(moves[1:] / np.maximum(moves[:-1], 1e-300), 1.0)))
    return Approach(once, periods, passages, scale, time, remaining, growth)


#: Width of the differences for the derivative, relative to the motion's size; tolerance of the run that is followed,
#: with contacts from a table, and of several modes, whose contacts are integrated: differences have to be smooth.
_WIDTH, _FOLLOWING, _FOLLOWING_MODES = 1e-5, 1e-4, 1e-7
#: Step beyond which the derivative is taken again.
_CURVED = 1e-2
#: Steps with the derivative taken anew, and at the fidelity asked for, at most.
_COARSE_STEPS, _FINE_STEPS = 6, 4
#: How many passages in a row have to be nearer to the motion found than the one before: else it is another one.
_NEARER = 3
#: How many more passages have to draw nearer where steps had to improve the derivative, as near grazing.
_FOLLOWED_ON = 12
#: Modulus of a multiplier from which on the derivative is taken once more, at the motion found.
_NEAR_ONE = 0.9
#: Growth of the distance between passages on the way from which on a transient is no plain approach, and the tolerance
#: of the run that is followed may decide which motion it ends in.
_WANDERED = 3.0
#: Tolerance with which the motion of the tabulated contacts is brought near the one asked for.
_BETWEEN = 1e-7
#: Share of the tolerance with which the periods of the solution are integrated, and the finest tolerance.
_SHARE, _FINEST = 0.1, 1e-12


def steady_state(scene: Scene, fidelity: str = "auto", rtol: float | None = None) -> SteadySearch:
    """Return the steady motion that a scene ends in, as if its last excitation and ceiling went on for ever.

    fidelity, rtol: of the solution, as in `simulate`. A search that finds none is a result with its reason. Raises
    NumericalFailure where the transient does not run as it should, SceneError where a controller moves the ceiling, and
    for an unknown fidelity.
    """
    scene.require_prescribed_ceiling()
    choice = choose(scene, fidelity)
    still = still_from(scene)
    if not scene.excitation.is_tone or still >= scene.duration:
        return SteadySearch(SteadyEnding.CHANGING)
    conditions = Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])
    asked = rtol_of(scene) if rtol is None else rtol
    following = _FOLLOWING if scene.modes is None else _FOLLOWING_MODES
    quick = Integration(scene, "finite" if complete_fidelity(scene) == "soft" else "impact", following)
    fine = quick.at_level(choice.fidelity, max(_FINEST, _SHARE * asked))
    known = choice.model_error + asked
    approach = follow(scene, quick, conditions, still)
    if approach is not None and approach.growth <= _WANDERED:
        found = _solve(approach, quick, fine, conditions, known)
        if found is not None:
            return SteadySearch(SteadyEnding.FOUND, found)
    return run_on(scene, fine, conditions, still, known, asked)


def _solve(
    approach: Approach, quick: Integration, fine: Integration, conditions: Conditions, known: float
) -> SteadyState | None:
    """Return the fixed point near a transient that contracts; known: relative error that steps do not remove."""
    coarse = approach.once
    if approach.periods > 1:
        coarse = ReturnMap(quick, conditions, approach.once.phase, approach.periods)
    for start in (extrapolated(approach.passages, approach.scale), approach.passages[-1]):
        try:
            found = _solved_from(start, approach, coarse, fine, known)
        except (NumericalFailure, np.linalg.LinAlgError):
            continue
        if found is not None:
            return found
    return None


def _solved_from(
    start: Array, approach: Approach, coarse: ReturnMap, fine: Integration, known: float
) -> SteadyState | None:
    """Return the stable motion to which Newton's steps from a section state (n,) lead; None where there is none.

    Raises NumericalFailure, LinAlgError.
    """
    exact, newton = coarse.by(fine), _Newton(approach, known, start)
    for _ in range(_COARSE_STEPS):  # first the motion of the tabulated contacts, next to the one asked for
        after, slope = coarse.forward_differences(newton.section, _WIDTH * approach.scale)
        newton.derive(slope)
        newton.step(after)
        if newton.left <= _CURVED:
            break
    if fine.rtol < _BETWEEN:
        newton.step(coarse.by(fine.at_level(fine.fidelity, _BETWEEN))(newton.section))
    newton.step(exact(newton.section))
    for _ in range(_FINE_STEPS):
        section = newton.section
        after, orbit = exact.passed(section)
        newton.step(after, alike=True)
        if newton.left <= known and (newton.improved or newton.leading > _NEAR_ONE):
            # the derivative beside an unstable motion may look stable, and its steps shorter than what is left
            newton.derive_again(coarse.forward_differences(section, _WIDTH * approach.scale)[1], after)
        if newton.left <= known:
            passages = approach.passages
            if fine.scene.modes is None:
                further = coarse.passages(passages[-1], _FOLLOWED_ON) if newton.improved else passages[:0]
                near = _draws_near(approach, section, further)
            else:
                near = arrives(coarse, passages[-1], section, approach.scale, newton.leading)
            if not near:
                return None
            return _described(approach, exact, orbit, section, newton.left + known)
    return None


def _draws_near(approach: Approach, section: Array, further: Array) -> bool:
    """Return whether the last passages of a transient, then further ones (k, n), lie nearer and nearer to a section."""
    passages = np.concatenate([approach.passages[-_NEARER - 1 :], further])
    apart = np.abs((passages - section) / approach.scale).max(axis=1)
    return bool((apart[1:] < apart[:-1]).all())


def _described(approach: Approach, exact: ReturnMap, orbit: Orbit, section: Array, error: float) -> SteadyState | None:
    multipliers = multipliers_at(exact, section, approach.scale)
    if abs(multipliers[0]) >= 1.0:
        return None
    found = orbit.amplitude, error, approach.periods, multipliers, approach.time, section, approach.once.phase
    return SteadyState(*found, named_impacts(orbit.impacts), exact.integration.fidelity)


#: How far steps may lead, in the distances that are left to go at the rate of contraction.
_FARTHEST = 5.0
#: Passages from which the end is extrapolated, and relative size of a part of their moves that depends on the others.
_MIXED, _DEPENDENT = 5, 1e-6


class _Newton:
    """Newton's steps to a fixed point near where a transient draws together, from a section state (n,)."""

    def __init__(self, approach: Approach, known: float, section: Array) -> None:
        """Begin; known: relative error that steps do not remove."""
        self.section, self.left, self.slope = section, math.inf, np.eye(len(section))
        self.improved = False  # whether steps had to improve the derivative
        self._inverse: Array = np.eye(len(section))
        self._last, self._scale, self._known = approach.passages[-1], approach.scale, known
        self._farthest = _FARTHEST * approach.remaining + known
        self._before: tuple[Array, Array] | None = None  # last section state and what is missing to its image

    def derive(self, slope: Array) -> None:
        """Take another derivative of the return map (n, n)."""
        self.slope, self._before = slope, None
        self._inverse = np.asarray(np.linalg.inv(np.eye(len(slope)) - slope), dtype=float)

    def step(self, after: Array, alike: bool = False) -> None:
        """Step from the section state (n,) to which `after` is the next passage; raises NumericalFailure if too far.

        alike: whether the last step was by the same map, so that it improves the derivative.
        """
        missing = after - self.section
        step = np.asarray(self._inverse @ missing, dtype=float)
        if alike and self._before is not None and _size(step, self._scale) > self._known:
            self._improve(self.section - self._before[0], self._before[1] - missing)
            step = np.asarray(self._inverse @ missing, dtype=float)
        self._before = self.section, missing
        self.left, self.section = _size(step, self._scale), self.section + step
        if not _size(self.section - self._last, self._scale) <= self._farthest:
            raise NumericalFailure("no fixed point near the transient")

    def derive_again(self, slope: Array, after: Array) -> None:
        """Make the last step, from a section state to which `after` is the next passage, with another derivative."""
        if self._before is not None:
            self.section = self._before[0]
        self.derive(slope)
        self.step(after)

    @property
    def leading(self) -> float:
        """Largest modulus of the derivative's eigenvalues: the factor by which disturbances shrink in the end."""
        return float(np.abs(np.linalg.eigvals(self.slope)).max())

    def _improve(self, moved: Array, closed: Array) -> None:
        """Broyden's update: a move (n,) has closed so much (n,) of what was missing."""
        row = (moved / self._scale**2) @ self._inverse
        share, self.improved = float(row @ closed), True
        if share != 0.0:
            self._inverse = self._inverse + np.outer(moved - self._inverse @ closed, row) / share


def _size(step: Array, scale: Array) -> float:
    """Return the largest part of a step (n,), relative to the motion's size."""
    return float(max(map(abs, (step / scale).tolist())))


def extrapolated(passages: Array, scale: Array) -> Array:
    """Return the section state (n,) to which passages (k, n) of a linear map would draw together: Anderson's mixing."""
    recent = passages[-_MIXED:] / scale
    moves = recent[1:] - recent[:-1]
    weights = np.linalg.lstsq((moves[1:] - moves[:-1]).T, moves[-1], rcond=_DEPENDENT)[0]
    end: Array = (recent[-1] - weights @ moves[1:]) * scale
    return end
