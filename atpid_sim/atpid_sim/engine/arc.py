# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Coefficients of the exact motion of the beam while no contact force acts on it (equations 3.39 and 3.43).

Inside one segment of the drive (see `drive.py`) the support moves as

    u(tau) = (a0 + a1 tau) sin(omega tau + phase) + c0 + c1 tau + c2 tau^2 + c3 tau^3

and the beam, a damped oscillator, has a closed form: a particular solution of the same shape plus a decaying free
vibration.
Close to resonance these two would be large and nearly cancel: there the tone's part is taken as it grows from nothing
at the start of the arc (docs/research/no_missed_impact.md).
"""

import math
from typing import NamedTuple

from atpid_sim.engine.columns import A0, A1, C0, C1, C2, C3, END, OMEGA, PHASE, START
from atpid_sim.kernel import inlined, kernel

#: A tone is close to resonance where the beam resists it with less than this share of its stiffness ...
_RESONANT = 0.03
#: ... and phase and size of the steady response are reached, in radians of their own, only after the row's end.
_UNSETTLED = 4.0


class Arc(NamedTuple):
    """Closed-form coefficients of the motion from local time `start` on [SI units]."""

    start: float
    mass: float
    stiffness: float
    damping: float
    gravity: float
    a0: float
    a1: float
    omega: float
    phase: float
    c0: float
    c1: float
    c2: float
    c3: float
    q0_in: float  # the forced part is q0 + q1 tau; in phase with sin
    q0_out: float  # and with cos
    q1_in: float  # close to resonance q0 + q1 (tau - start) is what makes it grow, see `growth`
    q1_out: float
    resonant: bool
    beat: float  # close to resonance: the beam's damped angular frequency less that of the tone
    w0: float
    w1: float
    decay: float
    squared: float  # square of the damped angular frequency; negative where overdamped
    damped: float  # root of its absolute value
    free: float  # free vibration at `start`
    free_velocity: float  # its velocity there, corrected for the decay
    modes: None  # one; `modal_arc.ModalArc` has several


@kernel
def support_at(segment, tau):
    """Support displacement [m] and velocity [m/s] at local time tau [s] of a row of the drive table, (12,) float64."""
    u = segment[C0] + tau * (segment[C1] + tau * (segment[C2] + tau * segment[C3]))
    velocity = segment[C1] + tau * (2.0 * segment[C2] + tau * 3.0 * segment[C3])
    if segment[A0] != 0.0 or segment[A1] != 0.0:
        angle = segment[OMEGA] * tau + segment[PHASE]
        s, c = math.sin(angle), math.cos(angle)
        amplitude = segment[A0] + segment[A1] * tau
        u += amplitude * s
        velocity += segment[A1] * s + segment[OMEGA] * amplitude * c
    return u, velocity


@kernel
def forced(q_in, q_out, rate_in, rate_out, omega, phase, c0, c1, c2, c3, w0, w1, tau):
    """Particular solution and its velocity at tau, where the tone's part has this amplitude, changing at this rate."""
    angle = omega * tau + phase
    s, c = math.sin(angle), math.cos(angle)
    x = q_in * s + q_out * c + c0 + w0 + tau * (c1 + w1 + tau * (c2 + tau * c3))
    v = (rate_in - omega * q_out) * s + (rate_out + omega * q_in) * c + c1 + w1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    return x, v


@inlined
def is_resonant(transfer, stiffness, omega, segment):
    """Whether a tone is close to resonance, and the steady response reached only after the row's end."""
    resistance = abs(transfer.real) + abs(transfer.imag)
    if resistance < _RESONANT * stiffness:
        return resistance * omega * (segment[END] - segment[START]) < _UNSETTLED * stiffness
    return False


@kernel
def growth(mass, transfer, drive, damping, a0, a1, omega, decay, damped):
    """Close to resonance: the two coefficients that make the forced part grow, and the beat [SI units].

    With x = Im[q e^(i omega tau)] the equation reads (D - slow)(D - fast) q = force / mass, where slow * fast is
    transfer / mass. Dividing by the fast factor alone meets nothing small: (D - slow) q = q0 + q1 s remains.
    """
    fast = complex(-decay, -omega - damped)
    q1 = -drive * a1 / (mass * fast)
    q0 = (q1 - (drive * a0 + damping * a1) / mass) / fast
    return q0, q1, (transfer / (mass * fast)).imag


@kernel
def arc_from(mass, system, segment, tau, x, v):
    """Coefficients of the motion that starts at local time tau [s] with displacement x [m] and velocity v [m/s].

    `segment` is one row of the drive table, (12,) float64; `mass` is what moves: the beam alone, or beam and grain.
    """
    stiffness, damping, gravity = system.stiffness, system.damping, system.gravity
    a0, a1, omega, phase = segment[A0], segment[A1], segment[OMEGA], segment[PHASE]
    c0, c1, c2, c3 = segment[C0], segment[C1], segment[C2], segment[C3]
    decay = 0.5 * damping / mass
    squared = stiffness / mass - decay * decay
    damped = math.sqrt(abs(squared))
    q0 = q1 = q = q_rate = complex(0.0, 0.0)
    resonant, beat = False, 0.0
    if a0 != 0.0 or a1 != 0.0:
        transfer = complex(stiffness - mass * omega * omega, damping * omega)
        drive = complex(stiffness, omega * damping)
        resonant = is_resonant(transfer, stiffness, omega, segment)
        if resonant:
            q0, q1, beat = growth(mass, transfer, drive, damping, a0 + a1 * tau, a1, omega, decay, damped)
            q_rate = q0
        else:
            q1 = drive * a1 / transfer
            q0 = (drive * a0 + damping * a1 - complex(damping, 2.0 * omega * mass) * q1) / transfer
            q, q_rate = complex(q0.real + q1.real * tau, q0.imag + q1.imag * tau), q1
    w1 = -6.0 * mass * c3 / stiffness
    w0 = -(2.0 * mass * c2 + mass * gravity + damping * w1) / stiffness
    xp, vp = forced(q.real, q.imag, q_rate.real, q_rate.imag, omega, phase, c0, c1, c2, c3, w0, w1, tau)
    free = x - xp
    return Arc(
        tau, mass, stiffness, damping, gravity, a0, a1, omega, phase, c0, c1, c2, c3, q0.real, q0.imag, q1.real,
        q1.imag, resonant, beat, w0, w1, decay, squared, damped, free, v - vp + decay * free, None,
    )  # fmt: skip
