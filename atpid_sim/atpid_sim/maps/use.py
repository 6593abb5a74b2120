# SPDX-License-Identifier: Apache-2.0
"""Where a damper is of no use: its grain is not lifted, or what it takes off the beam is not worth opening it."""

import math

from atpid_sim.maps.response import DamperResponse

#: A reduction of the beam's amplitude below this is of no use: approach paths and model leave as much open [-].
LEAST_USE = 0.01
#: Frequencies over the natural one from which to which heights are selected [-].
LOWEST_RATIO, HIGHEST_RATIO = 0.5, 2.0


def closed_over_gravity(damper: DamperResponse, amplitude: float) -> float:
    """Return the closed beam's largest acceleration over gravity [-] at a support amplitude [m]; inf: no gravity."""
    gravity = damper.system.gravity
    acceleration = (2.0 * math.pi * damper.frequency) ** 2 * damper.closed_amplitude(amplitude)
    return acceleration / gravity if gravity > 0.0 else math.inf


def rests(damper: DamperResponse, amplitude: float) -> bool:
    """Whether the grain of a closed damper stays on the floor when it is opened: at every height the beam is the same.

    It is lifted where the floor falls away faster than gravity; opening the ceiling exerts no force.
    """
    return closed_over_gravity(damper, amplitude) <= 1.0
