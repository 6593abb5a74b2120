# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of a structure of several modes along an arc, in closed form, and bounds of what follows.

All modes answer a tone with that tone and a cubic with a cubic: these add up to one of each, and only the free
vibrations remain apart. What is fast and small is bounded by its size as well (docs/research/no_missed_impact.md).
"""

import cmath
import math
from typing import NamedTuple

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import growth, is_resonant
from atpid_sim.engine.modal_room import arc_row
from atpid_sim.kernel import inlined, kernel
from atpid_sim.system import Array

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
    resonant: float  # 1 or 0: all are numbers, so that a loop enters them
    beat: float
    p0: float  # the mode's answer to the cubic and to its weight
    p1: float
    p2: float
    p3: float


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
    modes: Array  # the table, in whose room `mode_arc` finds those of the arc


class Fast(NamedTuple):
    """Fast free vibrations at one instant: their part of the motion, bounds of its jerk and its size [SI units]."""

    x: float
    v: float
    a: float
    jerk: float
    size: float


@inlined
def mode_arc(modes, i):
    """One mode's part of the arc that was made last."""
    k = arc_row(modes)
    return ModeArc(
        modes[k, i], modes[k + 1, i], modes[k + 2, i], modes[k + 3, i], modes[k + 4, i],
        modes[k + 5, i], modes[k + 6, i], modes[k + 7, i], modes[k + 8, i], modes[k + 9, i],
        modes[k + 10, i], modes[k + 11, i], modes[k + 12, i], modes[k + 13, i], modes[k + 14, i],
        modes[k + 15, i], modes[k + 16, i], modes[k + 17, i], modes[k + 18, i], modes[k + 19, i],
    )  # fmt: skip


@kernel
def _enter(modes, i, arc):
    k = arc_row(modes)
    for row, number in enumerate(arc):
        modes[k + row, i] = number


@kernel
def modal_arc(modes, first, states, segment, tau):
    """Arc from local time tau, where the modes' displacements and velocities are in `states` (modes, 2 or more).

    first: row of the table with which the set of modes begins (`modal.ModeSet`). There is one arc at a time.
    """
    count = modes.shape[1]
    a0, a1, omega = segment[at.A0], segment[at.A1], segment[at.OMEGA]
    c0, c1, c2, c3 = segment[at.C0], segment[at.C1], segment[at.C2], segment[at.C3]
    tone, growing = a0 != 0.0 or a1 != 0.0, False
    turn = cmath.exp(complex(0.0, omega * tau + segment[at.PHASE])) if tone else complex(1.0, 0.0)
    q0_sum = q1_sum = complex(0.0, 0.0)
    p0_sum = p1_sum = p2_sum = p3_sum = 0.0
    pace = omega if tone else 0.0
    for i in range(count):
        mass, stiffness = modes[first + at.MASS, i], modes[first + at.STIFFNESS, i]
        damping = modes[first + at.DAMPING, i]
        direct, rate = modes[first + at.DIRECT, i], modes[first + at.RATE, i]
        decay = 0.5 * damping / mass
        squared = stiffness / mass - decay * decay
        damped = math.sqrt(abs(squared))
        p3 = direct * c3 / stiffness
        p2 = (direct * c2 + 3.0 * (rate * c3 - damping * p3)) / stiffness
        p1 = (direct * c1 + 2.0 * (rate * c2 - damping * p2) - 6.0 * mass * p3) / stiffness
        p0 = (direct * c0 + rate * c1 - damping * p1 - mass * (modes[first + at.WEIGHT, i] + 2.0 * p2)) / stiffness
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
        _enter(modes, i, ModeArc(
            tau, mass, stiffness, decay, squared, damped, free, states[i, at.Q_RATE] - v + decay * free, a1, omega,
            q0.real, q0.imag, q1.real, q1.imag, 1.0 if resonant else 0.0, beat, p0, p1, p2, p3,
        ))  # fmt: skip
    return ModalArc(
        tau, tone, omega, segment[at.PHASE], q0_sum, q1_sum, p0_sum, p1_sum, p2_sum, p3_sum, growing, pace, modes
    )
