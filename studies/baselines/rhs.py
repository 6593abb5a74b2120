# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The equations of motion in their usual form: one right-hand side, contact forces switched by the overlap.

State (6,): beam displacement [m] and velocity [m/s], grain displacement and velocity, then two integrals: work of the
support [J], and all work done on beam and grain [J], which the ledger compares with the energy gained.

The constants of a row are packed in one array (24,), which keeps a call from Python cheap: the drive row (12,), the
system (6,), the number of the law, and the first five of its parameters.
"""

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.columns import CEILING_VELOCITY, DRIVE_COLUMNS, HEIGHT
from atpid_sim.kernel import callback, kernel
from atpid_sim.kernel_inputs import Contact
from atpid_sim.system import Array, System

BEAM, BEAM_VELOCITY, GRAIN, GRAIN_VELOCITY, INPUT, WORK = range(6)

# Packed constants after those of the drive row.
BEAM_MASS, GRAIN_MASS, STIFFNESS, DAMPING, GRAVITY, RADIUS, LAW, PARAMETERS = range(DRIVE_COLUMNS, DRIVE_COLUMNS + 8)


def pack(row: Array, system: System, contact: Contact) -> Array:
    """Return one drive row (12,), the system and the contact as one array (24,)."""
    return np.concatenate([row, system[:-1], [contact.law], contact.parameters[:5]]).astype(np.float64)


@kernel
def _pushing(law, overlap, velocity, p):
    """Contact force [N]: never negative, and none without overlap."""
    if overlap <= 0.0:
        return 0.0
    return max(0.0, force(law, overlap, velocity, overlap, p))


@kernel
def drive_at(tau, q):
    """Support displacement [m] and velocity [m/s], ceiling height [m] at local time tau [s] of the row packed in q."""
    u, w = support_at(q, tau)
    return u, w, q[HEIGHT] + q[CEILING_VELOCITY] * tau


@kernel
def powers(x, v, z, w, drive, q):
    """Accelerations of beam and grain [m/s^2], power of the support and all power on beam and grain [W].

    Beam x, v and grain z, w [m, m/s]; `drive` from `drive_at` (equations 3.29-3.34, 3.39, 3.40, 3.43).
    """
    u, u_velocity, height = drive
    beam_mass, grain_mass, stiffness, damping = q[BEAM_MASS], q[GRAIN_MASS], q[STIFFNESS], q[DAMPING]
    gravity, radius = q[GRAVITY], q[RADIUS]
    law, p = int(q[LAW]), q[PARAMETERS:]
    ceiling_velocity = q[CEILING_VELOCITY]
    floor = _pushing(law, x - z, v - w, p)
    ceiling = _pushing(law, 2.0 * radius + z - x - height, w - v - ceiling_velocity, p)
    support = stiffness * (u - x) + damping * (u_velocity - v)
    beam = (support - floor + ceiling) / beam_mass - gravity
    grain = (floor - ceiling) / grain_mass - gravity
    given = support * u_velocity
    # the damper of the beam dissipates c (v - u')^2; the walls do the work of their forces, the ceiling's included
    work = given - damping * (v - u_velocity) ** 2 - floor * (v - w) - ceiling * (w - v)
    return beam, grain, given, work


@callback
def slope(tau, y, q):
    """dy/dt (6,) at local time tau [s] of the row packed in q."""
    out = np.empty(6)
    out[BEAM], out[GRAIN] = y[BEAM_VELOCITY], y[GRAIN_VELOCITY]
    out[BEAM_VELOCITY], out[GRAIN_VELOCITY], out[INPUT], out[WORK] = powers(
        y[BEAM], y[BEAM_VELOCITY], y[GRAIN], y[GRAIN_VELOCITY], drive_at(tau, q), q
    )
    return out


@kernel
def mechanical_energy(y, support, system):
    """Energy [J] of beam, spring and weights; `support` is the support's displacement [m]."""
    stretch = y[BEAM] - support
    kinetic = 0.5 * (system.beam_mass * y[BEAM_VELOCITY] ** 2 + system.grain_mass * y[GRAIN_VELOCITY] ** 2)
    weight = system.gravity * (system.beam_mass * y[BEAM] + system.grain_mass * y[GRAIN])
    return kinetic + 0.5 * system.stiffness * stretch * stretch + weight
