# SPDX-License-Identifier: Apache-2.0
"""The steady motion of a scene without waiting for it: the transient is followed until it contracts, then solved for.

Which motion a system ends in depends on how it got there, so the run is followed from its start, with contacts from a
table (`engine.settling_run`). Once the distance between passages of the section shrinks regularly, the motion it
shrinks to is a fixed point of the return map of period one or two. Newton's method finds it there at the fidelity asked
for, with a derivative from the tabulated contacts, which differs from the true one by far less than Newton's steps
need. The last of these steps is the period that verifies the motion.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns, drive
from atpid_sim.engine.settling_run import IN_CONTACT, REGULAR, settle
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.periodic.return_map import Conditions, Orbit, ReturnMap
from atpid_sim.periodic.solve import least_size, size_of
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.simulation.excitation import amplitude_points, frequency_points
from atpid_sim.simulation.fidelity import choose, complete_fidelity
from atpid_sim.simulation.integration import Integration, drive_table, rtol_of
from atpid_sim.system import Array

#: Periods before contraction is looked for; in the last of them the section is chosen.
_SETTLED = 4
#: Width of the differences for the derivative, relative to the motion's size; tolerance of the run that is followed.
_WIDTH, _FOLLOWING = 1e-5, 1e-4
#: Passages from which the end is extrapolated, and relative size of a part of their moves that depends on the others.
_MIXED, _DEPENDENT = 5, 1e-6
#: Step beyond which the derivative is taken again.
_CURVED = 1e-2
#: Steps with the derivative taken anew, and at the fidelity asked for, at most; how far they may lead, in the distances
#: that are left to go at the rate of contraction.
_COARSE_STEPS, _FINE_STEPS, _FARTHEST = 6, 3, 5.0
#: How many passages in a row have to be nearer to the motion found than the one before: else it is another one.
_NEARER = 3
#: How many more passages have to draw nearer where steps had to improve the derivative, as near grazing.
_FOLLOWED_ON = 12
#: Tolerance with which the motion of the tabulated contacts is brought near the one asked for.
_BETWEEN = 1e-7
#: Share of the tolerance with which the periods of the solution are integrated, and the finest tolerance.
_SHARE, _FINEST = 0.1, 1e-12
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
    """A transient that contracts: its passages of a section, and how far it still has to go."""

    once: ReturnMap  # of the run that was followed, over one period
    periods: int
    passages: Array  # section states (k, 4), `periods` apart
    scale: Array  # size of the motion (4,)
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
    still = _still_from(scene)
    if not isinstance(scene.excitation, HarmonicExcitation) or still >= scene.duration:
        return SteadySearch(SteadyEnding.CHANGING)
    conditions = Conditions(amplitude_points(scene)[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])
    asked = rtol_of(scene) if rtol is None else rtol
    quick = Integration(scene, "finite" if complete_fidelity(scene) == "soft" else "impact", _FOLLOWING)
    fine = quick.at_level(choice.fidelity, max(_FINEST, _SHARE * asked))
    approach = _follow(scene, quick, conditions, still)
    if not isinstance(approach, _Approach):
        return SteadySearch(approach)
    return _solve(approach, quick, fine, conditions, choice.model_error + asked)


def _still_from(scene: Scene) -> float:
    """Return the time from which on excitation and ceiling are what they are at the end [s]."""
    last = 0.0
    for points in (amplitude_points(scene), frequency_points(scene), scene.ceiling.heights):
        changes = [k for k in range(1, len(points)) if points[k][1] != points[k - 1][1]]
        last = max(last, float(points[changes[-1]][0]) if changes else 0.0)
    return last


def _follow(scene: Scene, quick: Integration, conditions: Conditions, still: float) -> _Approach | SteadyEnding:
    """Follow the scene until its passages of a section draw together regularly; still: when its last kink is [s]."""
    period = 1.0 / conditions.frequency
    begin = period * (math.ceil(still / period) + _SETTLED - 1)
    most = int((scene.duration - begin) / period)
    if most < 1:
        return SteadyEnding.IRREGULAR
    rows = _rows_until(scene, begin)
    state, sections = quick.initial_state(), np.empty((most, 4))
    table = _next_period(rows[-1], period)
    outcome, ending, passed, amplitude, count, periods, remaining = settle(
        quick.kernel_inputs, rows, table, state.y, state.n, least_size(conditions), quick.step_limit, sections
    )
    if outcome != Outcome.DONE:
        raise NumericalFailure(Outcome(outcome).sentence)
    if ending != REGULAR:
        return SteadyEnding.IN_CONTACT if ending == IN_CONTACT else SteadyEnding.IRREGULAR
    once = ReturnMap(quick, conditions, float(table[0, columns.PHASE]) / (2.0 * math.pi) % 1.0)
    passages, time = sections[:count][::-periods][::-1], begin + passed * period
    return _Approach(once, periods, passages, size_of(amplitude, conditions), time, remaining)


def _rows_until(scene: Scene, end: float) -> Array:
    """Return the drive table of a scene up to `end` [s]."""
    if scene.frequency_moves:
        whole = drive_table(scene, (end,))
        return whole[whole[:, columns.END] <= end]
    # kinks of the ceiling as points of the amplitude: rows need not be cut
    times, amplitudes = zip(*amplitude_points(scene), strict=True)
    edges = sorted({0.0, end, *(t for t in (*times, *(t for t, _ in scene.ceiling.heights)) if t < end)})
    points = list(zip(edges, np.interp(edges, times, amplitudes).tolist(), strict=True))
    rows = drive.harmonic_rows(points, scene.frequency_hz, end)
    drive.enter_ceiling(rows, scene.ceiling.heights)
    return rows


def _next_period(row: Array, period: float) -> Array:
    """Return the row (1, DRIVE_COLUMNS) of the period [s] after one of constant conditions, from time zero on."""
    following = row[None].copy()
    following[0, columns.PHASE] += row[columns.OMEGA] * (row[columns.END] - row[columns.START])
    following[0, columns.START], following[0, columns.END] = 0.0, period
    return following


class _Newton:
    """Newton's steps to a fixed point near where a transient draws together, from a section state (4,)."""

    def __init__(self, approach: _Approach, known: float, section: Array) -> None:
        """Begin; known: relative error that steps do not remove."""
        self.section, self.left, self.slope = section, math.inf, _IDENTITY
        self.improved = False  # whether steps had to improve the derivative
        self._inverse: NDArray[np.floating[Any]] = _IDENTITY
        self._last, self._scale, self._known = approach.passages[-1], approach.scale, known
        self._farthest = _FARTHEST * approach.remaining + known
        self._before: tuple[Array, Array] | None = None  # last section state and what is missing to its image

    def derive(self, slope: Array) -> None:
        """Take another derivative of the return map (4, 4)."""
        self.slope, self._inverse = slope, np.linalg.inv(_IDENTITY - slope)

    def step(self, after: Array, alike: bool = False) -> None:
        """Step from the section state (4,) to which `after` is the next passage; raises NumericalFailure if too far.

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

    def _improve(self, moved: Array, closed: Array) -> None:
        """Broyden's update: a move (4,) has closed so much (4,) of what was missing."""
        row = (moved / self._scale**2) @ self._inverse
        share, self.improved = float(row @ closed), True
        if share != 0.0:
            self._inverse = self._inverse + np.outer(moved - self._inverse @ closed, row) / share


def _size(step: Array, scale: Array) -> float:
    """Return the largest part of a step (4,), relative to the motion's size."""
    return float(max(map(abs, (step / scale).tolist())))


def _extrapolated(passages: Array, scale: Array) -> Array:
    """Return the section state (4,) to which passages (k, 4) of a linear map would draw together: Anderson's mixing."""
    recent = passages[-_MIXED:] / scale
    moves = recent[1:] - recent[:-1]
    weights = np.linalg.lstsq((moves[1:] - moves[:-1]).T, moves[-1], rcond=_DEPENDENT)[0]
    end: Array = (recent[-1] - weights @ moves[1:]) * scale
    return end


def _solve(
    approach: _Approach, quick: Integration, fine: Integration, conditions: Conditions, known: float
) -> SteadySearch:
    """Return the fixed point near a transient that contracts; known: relative error that steps do not remove."""
    coarse = approach.once
    if approach.periods > 1:
        coarse = ReturnMap(quick, conditions, approach.once.phase, approach.periods)
    for start in (_extrapolated(approach.passages, approach.scale), approach.passages[-1]):
        try:
            found = _solved_from(start, approach, coarse, fine, known)
        except (NumericalFailure, np.linalg.LinAlgError):
            continue
        if found is not None:
            return SteadySearch(SteadyEnding.FOUND, found)
    return SteadySearch(SteadyEnding.NOT_CONVERGED)


def _solved_from(
    start: Array, approach: _Approach, coarse: ReturnMap, fine: Integration, known: float
) -> SteadyState | None:
    """Return the stable motion to which Newton's steps from a section state (4,) lead; None where there is none.

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
        if newton.left <= known:
            passages = approach.passages
            further = coarse.passages(passages[-1], _FOLLOWED_ON) if newton.improved else passages[:0]
            if not _draws_near(approach, section, further):
                return None
            return _described(approach, fine, orbit, section, newton.slope, newton.left + known)
    return None


def _draws_near(approach: _Approach, section: Array, further: Array) -> bool:
    """Return whether the last passages of a transient, then further ones (k, 4), lie nearer and nearer to a section."""
    passages = np.concatenate([approach.passages[-_NEARER - 1 :], further])
    apart = np.abs((passages - section) / approach.scale).max(axis=1)
    return bool((apart[1:] < apart[:-1]).all())


def _described(
    approach: _Approach, fine: Integration, orbit: Orbit, section: Array, slope: Array, error: float
) -> SteadyState | None:
    multipliers = np.linalg.eigvals(slope).astype(complex)
    multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
    if abs(multipliers[0]) >= 1.0:
        return None
    return SteadyState(
        orbit.amplitude, error, approach.periods, multipliers, approach.time, section, approach.once.phase,
        orbit.impacts, fine.fidelity,
    )  # fmt: skip
