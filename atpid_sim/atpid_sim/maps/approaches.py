# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Approach paths to a height: near the optimum the motion depends on the path of the ceiling before."""

from collections.abc import Callable
from functools import partial

from atpid_sim.maps.response import DamperResponse, Path

#: From a damper, a height [m] and a time to settle at the first height [s] to the path of the ceiling.
Approach = Callable[[DamperResponse, float, float], Path]
#: Duration of slow travels of the ceiling [s]: the thesis's opening time.
TRAVEL = 1.0
#: Duration of a quick travel [periods].
_QUICK = 0.05
#: Clearance before the ceiling is raised or lowered, as a share of the final one.
_BELOW, _ABOVE = 0.5, 1.25


def at_once(_damper: DamperResponse, height: float, _rest: float) -> Path:
    """Open the closed damper at once."""
    return ((0.0, height),)


def opened(damper: DamperResponse, height: float, _rest: float) -> Path:
    """Open the closed damper slowly."""
    return (0.0, damper.diameter), (TRAVEL, height)


def _passed(damper: DamperResponse, height: float, rest: float, share: float) -> Path:
    """Come from another clearance, settled there: a share of the final one."""
    before = damper.diameter + share * (height - damper.diameter)
    return (0.0, before), (rest, before), (rest + TRAVEL, height)


raised: Approach = partial(_passed, share=_BELOW)
lowered: Approach = partial(_passed, share=_ABOVE)


def travelled(present: float, speed: float, delay: float = 0.0) -> Approach:
    """Come from a present height [m], settled there, at a speed [m/s], a delay [s] later."""

    def approach(_damper: DamperResponse, height: float, rest: float) -> Path:
        start = rest + delay
        return (0.0, present), (start, present), (start + max(abs(height - present) / speed, 1e-6), height)

    return approach


def later(approach: Approach, periods: float) -> Approach:
    """Move the ceiling as an approach does, so many periods of the support later: in another phase of the motion."""

    def path(damper: DamperResponse, height: float, rest: float) -> Path:
        (_, first), *moves = approach(damper, height, rest)
        delay = periods * damper.period
        if not moves:  # opened at once
            first, moves = damper.diameter, [(_QUICK * damper.period, height)]
        return (0.0, first), (delay, first), *((delay + time, reached) for time, reached in moves)

    return path


def _jumped(damper: DamperResponse, height: float, rest: float, phase: float, share: float) -> Path:
    """Raise the ceiling quickly from a share of the clearance, settled there, in a phase [periods].

    Not at once: a ceiling of 1e5 m/s that leaves a grain in contact tears it, where the contact is damped.
    """
    before, begin = damper.diameter + share * (height - damper.diameter), rest + phase * damper.period
    return (0.0, before), (begin, before), (begin + _QUICK * damper.period, height)


#: Raised quickly, in several phases: after these some motions stay irregular that are regular after all others.
JUMPS: tuple[Approach, ...] = tuple(
    partial(_jumped, phase=phase, share=share)
    for phase, share in ((0.37, 0.5), (0.71, 0.5), (0.11, 0.25), (0.62, 0.25), (0.45, 0.1), (0.9, 0.1), (0.27, 0.75))
)
#: All: a height that is good after each of them is good from every previous state.
ALL_APPROACHES: tuple[Approach, ...] = (raised, lowered, opened, at_once)
#: Approaches of a damper that is closed now.
FROM_CLOSED: tuple[Approach, ...] = (raised, opened, at_once)
