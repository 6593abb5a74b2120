# SPDX-License-Identifier: Apache-2.0
"""What a height comes to in one system of many, and the height that is best in the worst of them."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from atpid_sim.maps.ratings import FLAT
from atpid_sim.simulation.quantities import efficiency

#: An irregular motion counts as this many times as large: a height that is safe avoids it.
RUMBLE = 1.5


class Response(NamedTuple):
    """The response of one system at a height."""

    amplitude: float  # of the beam, half peak-to-peak [m]
    efficiency: float  # 1 - amplitude / amplitude of the same system with the damper closed [-]
    regular: bool
    bare: float = math.nan  # the same system without the damper, where that is asked for [m]

    @property
    def reduction(self) -> float:
        """1 - amplitude / amplitude of the same system without the damper [-]."""
        return efficiency(self.amplitude, self.bare)

    @property
    def rating(self) -> float:
        """The amplitude [m], raised where the motion is irregular."""
        return self.amplitude * (1.0 if self.regular else RUMBLE)


def lowest_best(worst: Mapping[float, float]) -> float:
    """Return the lowest height [m] of {height [m]: largest rating over the systems [m]} that is as good as the best."""
    limit = min(worst.values()) * (1.0 + FLAT)
    return min(height for height, rating in worst.items() if rating <= limit)
