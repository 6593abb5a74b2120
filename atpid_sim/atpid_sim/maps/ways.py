# SPDX-License-Identifier: Apache-2.0
"""Ways to a height: near the cliff what a damper does depends on where its ceiling came from."""

from __future__ import annotations

from collections.abc import Callable

from atpid_sim.maps.rig import Path, Rig

#: From a rig, a height [m] and a time to settle where the way begins [s] to the ceiling's path.
Way = Callable[[Rig, float, float], Path]

#: Time the ceiling takes for slow travels [s]: the thesis's opening time.
TRAVEL = 1.0

#: Where the ceiling stands before it is raised or lowered, as shares of the clearance.
_BELOW, _ABOVE = 0.5, 1.25


def at_once(rig: Rig, height: float, rest: float) -> Path:
    """Open the closed damper at once."""
    del rig, rest
    return ((0.0, height),)


def opened(rig: Rig, height: float, rest: float) -> Path:
    """Open the closed damper slowly."""
    del rest
    return (0.0, rig.diameter), (TRAVEL, height)


def raised(rig: Rig, height: float, rest: float) -> Path:
    """Come from half the clearance, settled there."""
    return _passed(rig, height, rest, _BELOW)


def lowered(rig: Rig, height: float, rest: float) -> Path:
    """Come from a quarter more clearance, settled there."""
    return _passed(rig, height, rest, _ABOVE)


def travelled(present: float, speed: float, delay: float = 0.0) -> Way:
    """Come from a present height [m], settled there, at a speed [m/s], a delay [s] later."""

    def way(rig: Rig, height: float, rest: float) -> Path:
        del rig
        start = rest + delay
        return (0.0, present), (start, present), (start + max(abs(height - present) / speed, 1e-6), height)

    return way


#: Every way: a height that is good by all of them is good whatever was before.
ALL_WAYS: tuple[Way, ...] = (raised, lowered, opened, at_once)

#: Ways of a damper that is closed now.
FROM_CLOSED: tuple[Way, ...] = (raised, opened, at_once)


def _passed(rig: Rig, height: float, rest: float, share: float) -> Path:
    before = rig.diameter + share * (height - rig.diameter)
    return (0.0, before), (rest, before), (rest + TRAVEL, height)
