# SPDX-License-Identifier: Apache-2.0
"""Closed forms of impacts: Hertz on a wall, and a ball that bounces to rest."""

import math
from typing import NamedTuple


class HertzImpact(NamedTuple):
    """An elastic impact of a sphere on a flat wall."""

    force: float  # largest [N]
    overlap: float  # largest [m]
    duration: float  # [s]


def hertz_impact(stiffness: float, mass: float, speed: float) -> HertzImpact:
    """Return the impact of a mass [kg] at a speed [m/s] on F = k x^1.5, `stiffness` k in N/m^1.5 (Hertz 1882)."""
    overlap = (1.25 * mass * speed**2 / stiffness) ** 0.4
    # twice the integral of dx / sqrt(1 - x^2.5) from 0 to 1, by the beta function
    factor = 0.8 * math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)
    return HertzImpact(stiffness * overlap**1.5, overlap, factor * overlap / speed)


def bouncing_time(speed: float, restitution: float, gravity: float) -> float:
    """Return when [s] a ball thrown up from the floor at a speed [m/s] has bounced to rest: infinitely many impacts."""
    return 2.0 * speed / (gravity * (1.0 - restitution))
