# SPDX-License-Identifier: Apache-2.0
"""Mass modification and pseudo-inertial force of a moving grain (Eqs 3.47 to 3.54)."""

import numpy as np

from atpid_sim.system import Array


def mass_modification(grain_mass: float, beam: Array, grain: Array, gravity: float) -> Array:
    """Return the change of the system's mass (n,) [kg] from accelerations of beam and grain (n,) [m/s^2] (Eq. 3.53).

    Minus the grain's mass in flight (Eq. 3.50), 0 where both move as one; not finite where the beam falls freely.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-grain_mass * (1.0 - (grain + gravity) / (beam + gravity)))


def pseudo_inertial_force(grain_mass: float, beam: Array, grain: Array) -> Array:
    """Return the force m_g (x_g'' - x_s'') (n,) [N] from accelerations (n,) [m/s^2] (Eq. 3.54)."""
    return np.asarray(grain_mass * (grain - beam))


def natural_frequency(mass: float, stiffness: float) -> float:
    """Return the natural frequency [Hz] of a mass [kg] on a spring [N/m] (Eq. 3.45)."""
    return float(np.sqrt(stiffness / mass) / (2.0 * np.pi))
