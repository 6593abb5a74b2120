# SPDX-License-Identifier: Apache-2.0
"""What every part computes with: arrays, and the system's masses, spring, damper and weight."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Numbers; the docstrings give shape and unit.
Array = NDArray[np.float64]


class System(NamedTuple):
    """Beam and grain (equations 3.39 and 3.40), SI units; plain floats, so that numba kernels take it as it is."""

    beam_mass: float
    grain_mass: float
    stiffness: float
    damping: float
    gravity: float
    radius: float


def reduced_mass(system: System) -> float:
    """Mass that the relative motion of grain and container feels in an impact, m_s m_g / (m_s + m_g) [kg]."""
    return system.beam_mass * system.grain_mass / (system.beam_mass + system.grain_mass)
