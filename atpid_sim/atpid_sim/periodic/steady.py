# SPDX-License-Identifier: Apache-2.0
"""The steady motion of a scene without waiting for it: the transient is followed until it contracts, then solved for.

Which motion a system ends in depends on how it got there, so the run is followed from its start, with contacts from a
table (`engine.settling_run`). Once the distance between passages of the section shrinks regularly, the motion it
shrinks to is a fixed point of the return map of period one or two. Newton's method finds it there at the fidelity asked
for, with a derivative from the tabulated contacts, which differs from the true one by far less than Newton's steps
need. The last of these steps is the period that verifies the motion.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.approach import Approach, SteadyEnding, follow, still_from
from atpid_sim.periodic.newton import Newton, extrapolated, size
from atpid_sim.periodic.return_map import Conditions, Orbit, ReturnMap
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.simulation.excitation import amplitude_points
from atpid_sim.simulation.fidelity import choose, complete_fidelity
from atpid_sim.simulation.integration import Integration, rtol_of
from atpid_sim.system import Array

#: Width of the differences for the derivative, relative to the motion's size; tolerance of the run that is followed.
_WIDTH, _FOLLOWING = 1e-5, 1e-4
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
#: Growth of the distance between passages on the way from which on a transient is no plain approach.
_WANDERED = 3.0
#: Disturbance of the drive by which the growth of disturbances in a transient is measured, and the growth from which on
#: the tolerance of the run that is followed may decide which motion it ends in.
_SLIGHT, _GROWN = 1e-7, 100.0
#: Runs with the drive disturbed by up to that tolerance that then have to end in the same motion, and how near, as a
#: share of the amplitude. Where two motions are as likely, all end in one of them once in 256 times.
_REPEATED, _SAME = 8, 1e-3
#: Tolerance with which the motion of the tabulated contacts is brought near the one asked for.
_BETWEEN = 1e-7
#: Share of the tolerance with which the periods of the solution are integrated, and the finest tolerance.
_SHARE, _FINEST = 0.1, 1e-12
#: Least multiplier of which a logarithm is taken.
_LEAST = 1e-12


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


def steady_state(scene: Scene, fidelity: str = "auto", rtol: float | None = None) -> SteadySearch:
    """Return the steady motion that a scene ends in, as if its last excitation and ceiling went on for ever.

    fidelity, rtol: of the solution, as in `simulate`. A search that finds none is a result with its reason. Raises
    NumericalFailure where the transient does not run as it should, SceneError where a controller moves the ceiling,
    ValueError for an unknown fidelity.
    """
    scene.require_prescribed_ceiling()
    choice = choose(scene, fidelity)
    still = still_from(scene)
    if not isinstance(scene.excitation, HarmonicExcitation) or still >= scene.duration:
        return SteadySearch(SteadyEnding.CHANGING)
    conditions = Conditions(amplitude_points(scene)[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])
    asked = rtol_of(scene) if rtol is None else rtol
    quick = Integration(scene, "finite" if complete_fidelity(scene) == "soft" else "impact", _FOLLOWING)
    fine = quick.at_level(choice.fidelity, max(_FINEST, _SHARE * asked))
    approach = follow(scene, quick, conditions, still)
    if not isinstance(approach, Approach):
        return SteadySearch(approach)
    found = _solve(approach, quick, fine, conditions, choice.model_error + asked)
    if found.state is not None and approach.growth > _WANDERED:
        again = partial(follow, scene, quick, conditions, still)
        if _by_chance(again, approach, found.state.amplitude, quick, conditions):
            return SteadySearch(SteadyEnding.BY_CHANCE)
    return found


def _by_chance(
    follow: Callable[[float], Approach | SteadyEnding],
    approach: Approach,
    amplitude: float,
    quick: Integration,
    conditions: Conditions,
) -> bool:
    """Return whether the transient ends in other motions when it is followed with slightly disturbed drives.

    follow: follows it with the drive larger by a share; amplitude: of the beam in the motion found [m].
    """
    beside = follow(_SLIGHT)
    if isinstance(beside, Approach) and beside.alike(approach):
        apart = size(beside.passages[-1] - approach.passages[-1], approach.scale)
        if apart <= _GROWN * _SLIGHT:
            return False
    for part in np.linspace(-_FOLLOWING, _FOLLOWING, _REPEATED):
        other = follow(float(part))
        if not isinstance(other, Approach):
            return True
        ended = _solve(other, quick, quick.at_level(quick.fidelity, _BETWEEN), conditions, _FOLLOWING).state
        if ended is None or abs(ended.amplitude - amplitude) > _SAME * amplitude:
            return True
    return False


def _solve(
    approach: Approach, quick: Integration, fine: Integration, conditions: Conditions, known: float
) -> SteadySearch:
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
            return SteadySearch(SteadyEnding.FOUND, found)
    return SteadySearch(SteadyEnding.NOT_CONVERGED)


def _solved_from(
    start: Array, approach: Approach, coarse: ReturnMap, fine: Integration, known: float
) -> SteadyState | None:
    """Return the stable motion to which Newton's steps from a section state (4,) lead; None where there is none.

    Raises NumericalFailure, LinAlgError.
    """
    exact, newton = coarse.by(fine), Newton(approach, known, start)
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
            further = coarse.passages(passages[-1], _FOLLOWED_ON) if newton.improved else passages[:0]
            if not _draws_near(approach, section, further):
                return None
            return _described(approach, fine, orbit, section, newton.slope, newton.left + known)
    return None


def _draws_near(approach: Approach, section: Array, further: Array) -> bool:
    """Return whether the last passages of a transient, then further ones (k, 4), lie nearer and nearer to a section."""
    passages = np.concatenate([approach.passages[-_NEARER - 1 :], further])
    apart = np.abs((passages - section) / approach.scale).max(axis=1)
    return bool((apart[1:] < apart[:-1]).all())


def _described(
    approach: Approach, fine: Integration, orbit: Orbit, section: Array, slope: Array, error: float
) -> SteadyState | None:
    multipliers = np.linalg.eigvals(slope).astype(complex)
    multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
    if abs(multipliers[0]) >= 1.0:
        return None
    return SteadyState(
        orbit.amplitude, error, approach.periods, multipliers, approach.time, section, approach.once.phase,
        orbit.impacts, fine.fidelity,
    )  # fmt: skip
