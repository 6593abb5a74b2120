# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The periodic motion at a best height: its multipliers, the cliff above it, and the way back from beyond the cliff."""

import math
from dataclasses import dataclass, replace

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.maps import DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import Cliff, Conditions, Loss, PeriodicMotion, SearchEnding, find_cliff, periodic_motion
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation

#: Periods in which the ceiling travels, and in which the beam is watched.
TRAVEL, WATCH = 6, 16
#: Difference of amplitudes up to which two motions are one [-].
SAME = 0.01
#: Tolerance of the runs that make up a return map; first step towards the cliff and its resolution, over the height.
FINE, _STEP, _RESOLUTION = 1e-10, 0.01, 1e-5
#: How far above the best height a cliff is looked for.
_FARTHEST = 2.0
#: Periods after which motions are looked for to repeat themselves.
_PERIODS = (1, 2, 4)
#: Where there is no stable motion, it is looked for this much lower, as shares of the clearance: a motion just beyond a
#: fold lingers where the stable one was, for longer than any run (docs/research/atlas.md).
_LOWER = (0.005, 0.01, 0.02, 0.04)
#: The way back: from this clearance over that of the cliff, to so many heights between the best one and the cliff.
_BEYOND, _RETURNS = 1.15, 12


@dataclass(frozen=True)
class Stability:
    """The periodic motion at a best height; NaN where there is none, or no cliff."""

    ending: str  # of the search for period one: a name of `SearchEnding`
    periods: int = 0  # after which the motion repeats itself
    impacts: int = 0  # in these periods
    largest: float = math.nan  # largest modulus of the multipliers [-]
    largest_error: float = math.nan
    cliff: float = math.nan  # height up to which the motion is stable [m]
    loss: str = ""  # name of `Loss`: what ends it
    beat: float = math.nan  # angle of the leading multiplier at the cliff, in turns a period of the support
    recovered: float = math.nan  # height up to which it comes back when the ceiling is lowered from beyond [m]
    returns: int = 0  # runs made for that


def stability_of(scene: Scene, damper: DamperResponse, amplitude: float, height: float) -> Stability:
    """Return the periodic motion at a height [m], of period one, two or four, and the cliff above it.

    scene: its system; damper: the response of that, at the frequency and tolerance of the sweeps; amplitude: of the
    support [m]. Where the motion at the height is not stable the cliff lies below.
    """
    integration = Integration(scene, complete_fidelity(scene), FINE)
    ending, motion = _motion_at(integration, damper, Conditions(amplitude, damper.frequency, height))
    found = Stability(ending)
    if motion is not None:
        largest = motion.largest_multiplier
        found = Stability(ending, motion.periods, len(motion.impacts), largest, motion.multiplier_error)
    for share in _LOWER:
        if motion is not None and motion.stability_margin > 0.0:
            return _with_cliff(found, damper, integration, motion)
        lower = height - share * (height - damper.diameter)
        _, motion = _motion_at(integration, damper, Conditions(amplitude, damper.frequency, lower))
    return found


def _motion_at(
    integration: Integration, damper: DamperResponse, conditions: Conditions
) -> tuple[str, PeriodicMotion | None]:
    """Return how the search for period one ended, and the stable motion of the shortest period, else an unstable."""
    try:
        state = settled(damper, conditions)
    except NumericalFailure:
        return SearchEnding.NO_SECTION.name, None
    searches = []
    for periods in _PERIODS:
        searches.append(periodic_motion(integration, conditions, state, periods=periods))
        motion = searches[-1].motion
        if motion is not None and motion.stability_margin > 0.0:
            return searches[0].ending.name, motion
    return searches[0].ending.name, next((each.motion for each in searches if each.motion), None)


def settled(damper: DamperResponse, conditions: Conditions) -> State:
    """Return the state after the closed damper was opened slowly and the motion has settled, at phase zero."""
    path = (0.0, damper.diameter), (TRAVEL * damper.period, conditions.height)
    return _after(damper, conditions.amplitude, damper.closed_state(conditions.amplitude), path, 2.0)


def _after(
    damper: DamperResponse, amplitude: float, state: State, path: tuple[tuple[float, float], ...], share: float
) -> State:
    """Return the state after a path of the ceiling and a share of the settling time, watched, at phase zero."""
    end = (TRAVEL + math.ceil(share * damper.settling())) * damper.period
    later = state.copy()
    later.y[columns.TIME] = 0.0
    damper.advance(amplitude, later, path, Observation((end, end + WATCH * damper.period)))
    return later


def _with_cliff(
    found: Stability, damper: DamperResponse, integration: Integration, motion: PeriodicMotion
) -> Stability:
    height = motion.conditions.height
    end = find_cliff(integration, motion, _FARTHEST * height, _STEP * height, _RESOLUTION * height)
    if end.loss is Loss.NONE:
        return replace(found, loss=end.loss.name)
    recovered, returns = _recovered(damper, motion.conditions.amplitude, end)
    beat = abs(float(np.angle(end.last.multipliers[0]))) / (2.0 * math.pi * motion.periods)
    return replace(found, cliff=end.height, loss=end.loss.name, beat=beat, recovered=recovered, returns=returns)


def _recovered(damper: DamperResponse, amplitude: float, cliff: Cliff) -> tuple[float, int]:
    """Return the height [m] up to which the stable motion comes back from beyond the cliff, and the runs made.

    Tried upward from the lowest height of the branch, up to the first that keeps another motion; NaN where the lowest
    does.
    """
    beyond = damper.diameter + _BEYOND * (cliff.height - damper.diameter)
    heights = np.linspace(cliff.heights[0], cliff.height, _RETURNS, endpoint=False)
    recovered = math.nan
    try:
        irregular = _after(damper, amplitude, damper.closed_state(amplitude), ((0.0, beyond),), 1.0)
        for count, height in enumerate(heights, 1):
            path = (0.0, beyond), (TRAVEL * damper.period, float(height))
            state = _after(damper, amplitude, irregular, path, 2.0)
            stable = float(np.interp(height, cliff.heights, cliff.amplitudes))
            if abs(state.amplitude - stable) > SAME * stable:
                return recovered, count + 1
            recovered = float(height)
    except NumericalFailure:
        return recovered, len(heights)
    return recovered, len(heights) + 1
