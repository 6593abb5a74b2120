# SPDX-License-Identifier: Apache-2.0
"""A ball on a shaking table, x = A sin(phase): the motion with one impact a period, in closed form.

The ball leaves the table with g T / 2 and comes back with the same speed, so that the table moves with
g T (1 - e) / (2 (1 + e)) at the impact. The motion exists from an acceleration of pi (1 - e) / (1 + e) in g on, and
doubles its period where a multiplier of the return map is -1 (Luck and Mehta 1993; derived below from its trace).
"""

import cmath
import math
from typing import NamedTuple


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
