# SPDX-License-Identifier: Apache-2.0
"""Linear viscoelastic contact, F = k x + c x' (equation 3.8).

Parameters: (k [N/m], c [N s/m]).
"""

from __future__ import annotations

import math

from atpid_sim.kernel import kernel

DESCRIPTION = "linear spring and damper (Eq. 3.8)"


@kernel
def force(overlap, velocity, memory, p):  # type: ignore[no-untyped-def]
    """Contact force [N], not clamped."""
    return p[0] * overlap + p[1] * velocity


@kernel
def detachment_velocity(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Overlap velocity at which the force vanishes [m/s]."""
    if p[1] > 0.0:
        return -p[0] / p[1] * overlap
    return -math.inf if overlap >= 0.0 else math.inf


@kernel
def energy(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Stored energy [J]."""
    return 0.5 * p[0] * overlap * overlap


@kernel
def damped_restitution(zeta):  # type: ignore[no-untyped-def]
    """Restitution of a damped oscillator that detaches where its force vanishes, zeta its damping ratio [-].

    The force vanishes after the angle 2 arccos(zeta), so e = exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)); beyond
    critical damping arccosh takes its place (Schwager and Poeschel, Granular Matter 9 (2007) 465).
    """
    if zeta < 1.0 - 1e-9:
        return math.exp(-2.0 * zeta * math.acos(zeta) / math.sqrt(1.0 - zeta * zeta))
    if zeta > 1.0 + 1e-9:
        return math.exp(-2.0 * zeta * math.acosh(zeta) / math.sqrt(zeta * zeta - 1.0))
    return math.exp(-2.0)


@kernel
def restitution(speed, mass, p):  # type: ignore[no-untyped-def]
    """Restitution [-], the same at every speed [m/s]; mass [kg] is the reduced one."""
    return damped_restitution(0.5 * p[1] / math.sqrt(p[0] * mass))
