# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The cliff: the height up to which a periodic motion stays stable while the ceiling is raised, and what ends it."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.return_map import Conditions, ReturnMap, passage
from atpid_sim.periodic.solve import PeriodicMotion, size_of, solve
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: A motion further from the one before than this, relative to its size, is another branch.
_BRANCH = 0.2
#: Factor by which a step grows after a success.
_GROWTH = 1.5
#: Largest multiplier above which a motion that is lost there was about to become unstable.
_NEAR = 0.97
#: Distances from a wall, over the motion's size, within which differences lie on both sides of a touch: instantaneous
#: impacts, integrated contacts.
_BOTH_SIDES = (1e-6, 3e-5)


class Loss(Enum):
    """What ends a stable motion."""

    FOLD = "a real multiplier reaches +1: the motion meets an unstable one and both vanish"
    BRANCHING = "a real multiplier reaches +1 and the motion goes on: a symmetry breaks, two other motions branch off"
    DOUBLING = "a real multiplier reaches -1: every second period becomes different"
    BEATING = "a pair of complex multipliers reaches modulus 1: the motion begins to beat (Neimark-Sacker)"
    GRAZING = "an impact appears or vanishes at zero speed, and the multipliers jump"
    NONE = "the motion is stable up to the end of the range"


@dataclass(frozen=True)
class Cliff:
    """A branch of stable motions over the height, and its end."""

    height: float  # of the last stable motion [m]: the cliff, to the resolution asked for
    loss: Loss
    heights: Array  # (n,) rising [m]
    amplitudes: Array  # (n,) half peak-to-peak of the beam [m]
    largest: Array  # (n,) largest moduli of the multipliers [-]
    branch: tuple[PeriodicMotion, ...]  # (n,)

    @property
    def last(self) -> PeriodicMotion:
        """The last stable motion."""
        return self.branch[-1]


def find_cliff(
    integration: Integration, motion: PeriodicMotion, highest: float, step: float, resolution: float
) -> Cliff:
    """Follow a stable motion while the ceiling is raised, up to the height `highest` [m] at most, or lowered to it.

    step: the first [m]; steps grow while the motion is found and stable, and are halved where it is not or has become
    another, down to `resolution` [m]. Raises ValueError for a motion that is not stable, or invalid steps.
    """
    if not 0.0 < resolution <= step:
        raise ValueError(f"resolution: given {resolution:g} m; allowed: above 0 and at most the step, {step:g} m")
    if motion.stability_margin <= 0.0:
        raise ValueError(f"motion: given a largest multiplier of {motion.largest_multiplier:.4g}; allowed: below 1")
    branch = [motion]
    beyond: PeriodicMotion | None = None
    way = math.copysign(1.0, highest - motion.conditions.height)
    while (left := way * (highest - branch[-1].conditions.height)) > 0.0 and step >= resolution:
        height = branch[-1].conditions.height + step * way if step < left else highest
        found = raised(integration, branch[-1], height)
        if found is None or found.stability_margin <= 0.0:
            beyond = found or beyond
            step *= 0.5
            continue
        branch.append(found)
        step *= _GROWTH
        if beyond is not None and way * (beyond.conditions.height - height) <= 0.0:
            beyond = None  # an island in the range of stability
    last = branch[-1]
    reached = last.conditions.height == highest
    return Cliff(
        height=last.conditions.height,
        loss=Loss.NONE if reached else _loss(integration, last, beyond, resolution),
        heights=np.array([each.conditions.height for each in branch]),
        amplitudes=np.array([each.amplitude for each in branch]),
        largest=np.array([each.largest_multiplier for each in branch]),
        branch=tuple(branch),
    )


def raised(integration: Integration, motion: PeriodicMotion, height: float) -> PeriodicMotion | None:
    """Return the motion that a periodic one becomes at another height [m]; None where none is found nearby."""
    return changed(integration, motion, motion.conditions._replace(height=height))


def changed(integration: Integration, motion: PeriodicMotion, conditions: Conditions) -> PeriodicMotion | None:
    """Return the motion that a periodic one becomes under other conditions; None where none is found nearby."""
    try:
        # the section moves with the flight
        phase, section = passage(integration, motion.conditions, motion.state, motion.phase, motion.periods)
    except NumericalFailure:
        return None
    found = solve(ReturnMap(integration, conditions, phase, motion.periods), section).motion
    if found is None:
        return None
    moved = np.abs((found.section - section) / size_of(integration, motion.amplitude, conditions))
    return found if float(moved.max()) <= _BRANCH else None


def _loss(integration: Integration, last: PeriodicMotion, beyond: PeriodicMotion | None, resolution: float) -> Loss:
    """Return what ends a branch, from its last stable motion and the unstable one found just above, if any."""
    clearance = ReturnMap(integration, last.conditions, last.phase, last.periods).clearance(last.section)
    if clearance <= max(2.0 * resolution, _BOTH_SIDES[integration.fidelity != "impact"] * last.amplitude):
        return Loss.GRAZING  # multipliers beside a touch are none
    if beyond is not None and sorted(beyond.walls) == sorted(last.walls):
        leading = beyond.multipliers[0]
    elif last.largest_multiplier >= _NEAR:
        leading = last.multipliers[0]
    else:
        return Loss.GRAZING
    if abs(leading.imag) > 1e-6 * abs(leading):
        return Loss.BEATING
    return Loss.FOLD if leading.real > 0.0 else Loss.DOUBLING
