# SPDX-License-Identifier: Apache-2.0
"""Motion of a structure of several modes along an arc, in closed form, and bounds of what follows.

All modes answer a tone with that tone and a cubic with a cubic: these add up to one of each, and only the free
vibrations remain apart. What is fast and small is bounded by its size as well (docs/no_missed_impact.md).
"""

import cmath
import math
from typing import Any, NamedTuple

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import growth, is_resonant
from atpid_sim.kernel import inlined, kernel

#: A mode that is this many times as fast as the first and as the tone may be bounded by its size.
FAST = 2.0
#: Share of all motion below which a free vibration makes no turning point that matters.
STILL = 1e-9


class ModeArc(NamedTuple):
    """One mode's part of an arc [SI units]; names as those of `arc.Arc`, whose functions take it as well."""

    start: float
    mass: float
    stiffness: float
    decay: float
    squared: float
    damped: float
    free: float
    free_velocity: float
    a1: float
    omega: float
    q0_in: float
    q0_out: float
    q1_in: float
    q1_out: float
    resonant: bool
    beat: float
    p0: float  # the mode's answer to the cubic and to its weight
    p1: float
    p2: float
    p3: float


_COLUMNS = len(ModeArc._fields)


class ModalArc(NamedTuple):
    """The arc of a structure of several modes from local time `start` on [SI units]."""

    start: float
    tone: bool
    omega: float
    phase: float
    q0: complex  # of all modes that are not resonant, as in `arc.Arc`
    q1: complex
    p0: float  # of all modes
    p1: float
    p2: float
    p3: float
    growing: bool  # whether a mode is resonant
    pace: float  # angular frequency of the tone or of the first mode, the higher
    modes: Any  # (modes, columns), read by `mode_arc`


class Fast(NamedTuple):
    """Fast free vibrations at one instant: their part of the motion, bounds of its jerk and its size [SI units]."""

    x: float
    v: float
    a: float
    jerk: float
    size: float


@inlined
def mode_arc(rows, i):
    """One mode's part of an arc, from its row."""
    return ModeArc(
        rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5], rows[i, 6], rows[i, 7], rows[i, 8], rows[i, 9], rows[i, 10], rows[i, 11], rows[i, 12],
        rows[i, 13], rows[i, 14] != 0.0, rows[i, 15], rows[i, 16], rows[i, 17], rows[i, 18], rows[i, 19],
    )  # fmt: skip


@kernel
def _enter(rows, i, arc):
    rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5] = (
        arc.start, arc.mass, arc.stiffness, arc.decay, arc.squared, arc.damped
    )  # fmt: skip
    rows[i, 6], rows[i, 7], rows[i, 8], rows[i, 9], rows[i, 10], rows[i, 11] = (
        arc.free, arc.free_velocity, arc.a1, arc.omega, arc.q0_in, arc.q0_out
    )  # fmt: skip
    rows[i, 12], rows[i, 13], rows[i, 14], rows[i, 15] = arc.q1_in, arc.q1_out, 1.0 if arc.resonant else 0.0, arc.beat
    rows[i, 16], rows[i, 17], rows[i, 18], rows[i, 19] = arc.p0, arc.p1, arc.p2, arc.p3


@kernel
def modal_arc(modes, states, segment, tau):
    """Arc from local time tau, where the modes' displacements and velocities are in `states` (modes, 2 or more).

    modes: rows of one `modal.ModeSet`.
    """
    count = modes.shape[1]
    rows = np.empty((count, _COLUMNS))
    a0, a1, omega = segment[at.A0], segment[at.A1], segment[at.OMEGA]
    c0, c1, c2, c3 = segment[at.C0], segment[at.C1], segment[at.C2], segment[at.C3]
    tone, growing = a0 != 0.0 or a1 != 0.0, False
    turn = cmath.exp(complex(0.0, omega * tau + segment[at.PHASE])) if tone else complex(1.0, 0.0)
    q0_sum = q1_sum = complex(0.0, 0.0)
    p0_sum = p1_sum = p2_sum = p3_sum = 0.0
    pace = omega if tone else 0.0
    for i in range(count):
        mass, stiffness, damping = modes[at.MASS, i], modes[at.STIFFNESS, i], modes[at.DAMPING, i]
        direct, rate = modes[at.DIRECT, i], modes[at.RATE, i]
        decay = 0.5 * damping / mass
        squared = stiffness / mass - decay * decay
        damped = math.sqrt(abs(squared))
        p3 = direct * c3 / stiffness
        p2 = (direct * c2 + 3.0 * (rate * c3 - damping * p3)) / stiffness
        p1 = (direct * c1 + 2.0 * (rate * c2 - damping * p2) - 6.0 * mass * p3) / stiffness
        p0 = (direct * c0 + rate * c1 - damping * p1 - mass * (modes[at.WEIGHT, i] + 2.0 * p2)) / stiffness
        q0 = q1 = complex(0.0, 0.0)
        x, v = p0 + tau * (p1 + tau * (p2 + tau * p3)), p1 + tau * (2.0 * p2 + tau * 3.0 * p3)
        resonant, beat = False, 0.0
        if tone and (direct != 0.0 or rate != 0.0):
            transfer = complex(stiffness - mass * omega * omega, damping * omega)
            drive = complex(direct, omega * rate)
            resonant = is_resonant(transfer, stiffness, omega, segment)
            if resonant:
                growing = True
                q0, q1, beat = growth(mass, transfer, drive, rate, a0 + a1 * tau, a1, omega, decay, damped)
                v += (q0 * turn).imag
            else:
                q1 = drive * a1 / transfer
                q0 = (drive * a0 + rate * a1 - complex(damping, 2.0 * omega * mass) * q1) / transfer
                q0_sum, q1_sum = q0_sum + q0, q1_sum + q1
                q = (q0 + tau * q1) * turn
                x += q.imag
                v += (q1 * turn).imag + omega * q.real
        p0_sum, p1_sum, p2_sum, p3_sum = p0_sum + p0, p1_sum + p1, p2_sum + p2, p3_sum + p3
        free = states[i, at.Q] - x
        if i == 0:
            pace = max(pace, math.sqrt(stiffness / mass))
        _enter(rows, i, ModeArc(
            tau, mass, stiffness, decay, squared, damped, free, states[i, at.Q_RATE] - v + decay * free, a1, omega,
            q0.real, q0.imag, q1.real, q1.imag, resonant, beat, p0, p1, p2, p3,
        ))  # fmt: skip
    return ModalArc(
        tau, tone, omega, segment[at.PHASE], q0_sum, q1_sum, p0_sum, p1_sum, p2_sum, p3_sum, growing, pace, rows
    )
