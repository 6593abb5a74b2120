# SPDX-License-Identifier: Apache-2.0
"""The equations of motion as everybody else writes them: one right-hand side, contact forces switched by the overlap.

State (6,): beam displacement [m] and velocity [m/s], grain displacement and velocity, then two integrals that only
watch: work done by the support [J], and all work done on beam and grain [J], which the ledger holds against the energy
gained.

What a row needs is packed in one array (24,), so that a call from Python costs as little as it can: the drive row
(12,), the system (6,), the law's number, and the first five of its parameters.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from atpid_sim.contact import Contact
from atpid_sim.contact.dispatch import force
from atpid_sim.engine.beam import support_at
from atpid_sim.system import System

Array = NDArray[np.float64]

BEAM, BEAM_RATE, GRAIN, GRAIN_RATE, INPUT, WORK = range(6)


def pack(row: Array, system: System, contact: Contact) -> Array:
    """Return one drive row (12,), the system and the contact as one array (24,)."""
    return np.concatenate([row, system, [contact.law], contact.parameters[:5]]).astype(np.float64)


@njit(cache=True)
def _pushing(law, overlap, rate, p):  # type: ignore[no-untyped-def]
    """Contact force [N]: never negative, and none without overlap."""
    if overlap <= 0.0:
        return 0.0
    return max(0.0, force(law, overlap, rate, overlap, p))


@njit(cache=True)
def drive_at(tau, q):  # type: ignore[no-untyped-def]
    """Support displacement [m] and velocity [m/s], ceiling height [m] at local time tau [s] of the row packed in q."""
    u, u_rate = support_at(q[2], q[3], q[4], q[5], q[6], q[7], q[8], q[9], tau)
    return u, u_rate, q[10] + q[11] * tau


@njit(cache=True)
def powers(x, v, z, w, drive, q):  # type: ignore[no-untyped-def]
    """Accelerations of beam and grain [m/s^2], power of the support and all power on beam and grain [W].

    Beam x, v and grain z, w [m, m/s]; `drive` from `drive_at` (equations 3.29-3.34, 3.39, 3.40, 3.43).
    """
    u, u_rate, height = drive
    beam_mass, grain_mass, stiffness, damping, gravity, radius = q[12], q[13], q[14], q[15], q[16], q[17]
    law, p = int(q[18]), q[19:]
    height_rate = q[11]
    floor = _pushing(law, x - z, v - w, p)
    ceiling = _pushing(law, 2.0 * radius + z - x - height, w - v - height_rate, p)
    support = stiffness * (u - x) + damping * (u_rate - v)
    beam = (support - floor + ceiling) / beam_mass - gravity
    grain = (floor - ceiling) / grain_mass - gravity
    given = support * u_rate
    # the beam's damper takes c (v - u')^2; the walls take what they are pushed through, and the ceiling gives its share
    work = given - damping * (v - u_rate) ** 2 - floor * (v - w) - ceiling * (w - v)
    return beam, grain, given, work


@njit(cache=True)
def slope(tau, y, q):  # type: ignore[no-untyped-def]
    """dy/dt (6,) at local time tau [s] of the row packed in q."""
    out = np.empty(6)
    out[BEAM], out[GRAIN] = y[BEAM_RATE], y[GRAIN_RATE]
    out[BEAM_RATE], out[GRAIN_RATE], out[INPUT], out[WORK] = powers(y[0], y[1], y[2], y[3], drive_at(tau, q), q)
    return out


@njit(cache=True)
def mechanical_energy(y, support, system):  # type: ignore[no-untyped-def]
    """Energy [J] of beam, spring and weights; `support` is the support's displacement [m]."""
    stretch = y[BEAM] - support
    kinetic = 0.5 * (system.beam_mass * y[BEAM_RATE] ** 2 + system.grain_mass * y[GRAIN_RATE] ** 2)
    weight = system.gravity * (system.beam_mass * y[BEAM] + system.grain_mass * y[GRAIN])
    return kinetic + 0.5 * system.stiffness * stretch * stretch + weight
