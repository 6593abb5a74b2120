# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Closed forms of impacts: Hertz on a wall, a ball that bounces to rest, a ball on a shaking table.

On a table x = A sin(phase) the ball has one impact a period: it leaves the table with g T / 2 and comes back with the
same speed, so that the table moves with g T (1 - e) / (2 (1 + e)) at the impact. The motion exists from an acceleration
of pi (1 - e) / (1 + e) in g on, and doubles its period where a multiplier of the return map is -1 (Luck and Mehta 1993;
derived below from its trace).
"""

import cmath
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


#: Coefficients of `thornton_gamma`, of e to e^10.
_THORNTON = (-6.918798, -16.41105, 146.8049, -796.4559, 2928.711, -7206.864, 11494.29, -11342.18, 6276.757, -1489.915)


def thornton_gamma(restitution: float) -> float:
    """Return the damping factor gamma [-] of a Hertz contact without attraction for a restitution from 0 to 0.99.

    A fit to simulations (Thornton, Cummins and Cleary, Powder Technology 233 (2013) 30).
    """
    exponent = sum(h * restitution**power for power, h in enumerate(_THORNTON, 1))
    return math.sqrt(1.0 / (1.0 - (1.0 + restitution) ** 2 * math.exp(exponent)) - 1.0)


def bouncing_time(speed: float, restitution: float, gravity: float) -> float:
    """Return when [s] a ball thrown up from the floor at a speed [m/s] has bounced to rest: infinitely many impacts."""
    return 2.0 * speed / (gravity * (1.0 - restitution))


class ShakingTable(NamedTuple):
    """The system, dimensionless; `acceleration` is A omega^2 / g (Gamma)."""

    restitution: float
    acceleration: float

    @property
    def phase(self) -> float:
        """Phase of the table at the impact of the motion that can be stable [rad]; below `onset` a ValueError."""
        return math.acos(onset(self.restitution) / self.acceleration)

    @property
    def multipliers(self) -> tuple[complex, complex]:
        """Multipliers of the return map, the larger modulus first.

        Derivatives of instant and velocity from one impact to the next have the trace
        1 + e^2 - (1 + e)^2 Gamma sin(phase) and the determinant e^2.
        """
        e = self.restitution
        trace = 1.0 + e * e - (1.0 + e) ** 2 * self.acceleration * math.sin(self.phase)
        root = cmath.sqrt(0.25 * trace * trace - e * e)
        pair = (0.5 * trace + root, 0.5 * trace - root)
        return pair if abs(pair[0]) >= abs(pair[1]) else (pair[1], pair[0])


def onset(restitution: float) -> float:
    """Return the acceleration [g] from which the motion exists."""
    return math.pi * (1.0 - restitution) / (1.0 + restitution)


def doubling(restitution: float) -> float:
    """Return the acceleration [g] at which the motion becomes one of two periods."""
    e = restitution
    return math.hypot(onset(e), 2.0 * (1.0 + e * e) / (1.0 + e) ** 2)
