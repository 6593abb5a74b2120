# SPDX-License-Identifier: Apache-2.0
"""Exact motion of the beam while no contact force acts on it (equations 3.39 and 3.43 with zero contact force).

Inside one segment of the drive (see `drive.py`) the support moves as

    u(tau) = (a0 + a1 tau) sin(omega tau + phase) + c0 + c1 tau + c2 tau^2 + c3 tau^3

and the beam, a damped oscillator, has a closed form: a particular solution of the same shape plus a decaying swing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from atpid_sim.engine.kernel import kernel

#: Where an undamped beam is driven exactly at resonance there is no steady particular solution: it is then made stiffer
#: by twice this share, which a swing of any feasible length does not show.
_DETUNING = 1e-8


class Arc(NamedTuple):
    """Closed-form coefficients of one swing of the beam, from local time `start` on [SI units]."""

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
    q0_in: float  # part of the particular solution in phase with sin
    q0_out: float  # and with cos
    q1_in: float
    q1_out: float
    w0: float
    w1: float
    decay: float
    squared: float  # square of the damped angular frequency; negative where overdamped
    rate: float  # root of its absolute value
    swing: float  # homogeneous part at `start`
    swing_rate: float  # its rate, corrected for the decay


@kernel
def support_at(a0, a1, omega, phase, c0, c1, c2, c3, tau):  # type: ignore[no-untyped-def]
    """Support displacement [m] and velocity [m/s] at local time tau [s]."""
    u = c0 + tau * (c1 + tau * (c2 + tau * c3))
    rate = c1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    if a0 != 0.0 or a1 != 0.0:
        angle = omega * tau + phase
        s, c = math.sin(angle), math.cos(angle)
        amplitude = a0 + a1 * tau
        u += amplitude * s
        rate += a1 * s + omega * amplitude * c
    return u, rate


@kernel
def _forced(q0_in, q0_out, q1_in, q1_out, omega, phase, c0, c1, c2, c3, w0, w1, tau):  # type: ignore[no-untyped-def]
    """Particular solution and its rate at tau."""
    angle = omega * tau + phase
    s, c = math.sin(angle), math.cos(angle)
    q_in = q0_in + q1_in * tau
    q_out = q0_out + q1_out * tau
    x = q_in * s + q_out * c + c0 + w0 + tau * (c1 + w1 + tau * (c2 + tau * c3))
    v = (q1_in - omega * q_out) * s + (q1_out + omega * q_in) * c + c1 + w1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    return x, v


@kernel
def arc_from(mass, stiffness, damping, gravity, segment, tau, x, v):  # type: ignore[no-untyped-def]
    """Coefficients of the swing that starts at local time tau [s] with displacement x [m] and velocity v [m/s].

    `segment` is one row of the drive table, (12,) float64; `mass` is what swings: the beam alone, or beam and grain.
    """
    a0, a1, omega, phase = segment[2], segment[3], segment[4], segment[5]
    c0, c1, c2, c3 = segment[6], segment[7], segment[8], segment[9]
    q0_in = q0_out = q1_in = q1_out = 0.0
    if a0 != 0.0 or a1 != 0.0:
        real = stiffness - mass * omega * omega
        imag = damping * omega
        if abs(real) + abs(imag) < _DETUNING * stiffness:
            stiffness *= 1.0 + 2.0 * _DETUNING
            real = stiffness - mass * omega * omega
        transfer = complex(real, imag)
        drive = complex(stiffness, omega * damping)
        q1 = drive * a1 / transfer
        q0 = (drive * a0 + damping * a1 - complex(damping, 2.0 * omega * mass) * q1) / transfer
        q0_in, q0_out, q1_in, q1_out = q0.real, q0.imag, q1.real, q1.imag
    w1 = -6.0 * mass * c3 / stiffness
    w0 = -(2.0 * mass * c2 + mass * gravity + damping * w1) / stiffness
    xp, vp = _forced(q0_in, q0_out, q1_in, q1_out, omega, phase, c0, c1, c2, c3, w0, w1, tau)
    decay = 0.5 * damping / mass
    squared = stiffness / mass - decay * decay
    swing = x - xp
    return Arc(
        tau, mass, stiffness, damping, gravity, a0, a1, omega, phase, c0, c1, c2, c3, q0_in, q0_out, q1_in, q1_out,
        w0, w1, decay, squared, math.sqrt(abs(squared)), swing, v - vp + decay * swing,
    )  # fmt: skip


@kernel
def _swing(arc, s):  # type: ignore[no-untyped-def]
    """Homogeneous part of the motion and its rate, s seconds after the start of the arc."""
    angle = arc.rate * s
    if arc.squared > 0.0 and angle > 1e-8:
        fade = math.exp(-arc.decay * s)
        cosine = fade * math.cos(angle)
        sine = fade * math.sin(angle) / arc.rate
    elif arc.squared < 0.0 and angle > 1e-8:
        slow = math.exp((arc.rate - arc.decay) * s)
        fast = math.exp(-(arc.rate + arc.decay) * s)
        cosine = 0.5 * (slow + fast)
        sine = 0.5 * (slow - fast) / arc.rate
    else:
        cosine = math.exp(-arc.decay * s)
        sine = cosine * s
    x = arc.swing * cosine + arc.swing_rate * sine
    v = -arc.decay * x - arc.swing * arc.squared * sine + arc.swing_rate * cosine
    return x, v


@kernel
def beam_at(arc, tau):  # type: ignore[no-untyped-def]
    """Beam displacement, velocity, acceleration and support displacement, velocity at local time tau [SI units]."""
    x, v = _swing(arc, tau - arc.start)
    u = arc.c0 + tau * (arc.c1 + tau * (arc.c2 + tau * arc.c3))
    rate = arc.c1 + tau * (2.0 * arc.c2 + tau * 3.0 * arc.c3)
    x += u + arc.w0 + arc.w1 * tau
    v += rate + arc.w1
    if arc.a0 != 0.0 or arc.a1 != 0.0:
        angle = arc.omega * tau + arc.phase
        s, c = math.sin(angle), math.cos(angle)
        q_in = arc.q0_in + arc.q1_in * tau
        q_out = arc.q0_out + arc.q1_out * tau
        x += q_in * s + q_out * c
        v += (arc.q1_in - arc.omega * q_out) * s + (arc.q1_out + arc.omega * q_in) * c
        amplitude = arc.a0 + arc.a1 * tau
        u += amplitude * s
        rate += arc.a1 * s + arc.omega * amplitude * c
    a = (arc.stiffness * (u - x) + arc.damping * (rate - v)) / arc.mass - arc.gravity
    return x, v, a, u, rate


@kernel
def bounded_at(arc, tau, until):  # type: ignore[no-untyped-def]
    """Beam displacement, velocity, acceleration at local time tau, and a bound of its |jerk| [m/s^3] until `until`.

    The swing's jerk j obeys the same damped oscillator as the swing, so j'^2 + w0^2 j^2 never grows and
    |j| <= sqrt(j'^2 / w0^2 + j^2) from there on, under-, over- or critically damped alike. The particular
    solution's jerk is bounded by its envelope, which is linear in time. docs/no_missed_impact.md has the proof.
    """
    y, y1 = _swing(arc, tau - arc.start)
    u = arc.c0 + tau * (arc.c1 + tau * (arc.c2 + tau * arc.c3))
    rate = arc.c1 + tau * (2.0 * arc.c2 + tau * 3.0 * arc.c3)
    x = y + u + arc.w0 + arc.w1 * tau
    v = y1 + rate + arc.w1
    bound = 6.0 * abs(arc.c3)
    if arc.a0 != 0.0 or arc.a1 != 0.0:
        angle = arc.omega * tau + arc.phase
        s, c = math.sin(angle), math.cos(angle)
        q_in = arc.q0_in + arc.q1_in * tau
        q_out = arc.q0_out + arc.q1_out * tau
        x += q_in * s + q_out * c
        v += (arc.q1_in - arc.omega * q_out) * s + (arc.q1_out + arc.omega * q_in) * c
        amplitude = arc.a0 + arc.a1 * tau
        u += amplitude * s
        rate += arc.a1 * s + arc.omega * amplitude * c
        envelope = math.sqrt(q_in * q_in + q_out * q_out)
        squared = arc.omega * arc.omega
        if arc.a1 != 0.0:
            envelope = (
                max(envelope, math.hypot(arc.q0_in + arc.q1_in * until, arc.q0_out + arc.q1_out * until))
                + 3.0 * math.hypot(arc.q1_in, arc.q1_out) / arc.omega
            )
        bound += squared * arc.omega * envelope
    a = (arc.stiffness * (u - x) + arc.damping * (rate - v)) / arc.mass - arc.gravity
    natural = arc.stiffness / arc.mass
    twice = 2.0 * arc.decay
    y2 = -twice * y1 - natural * y
    y3 = -twice * y2 - natural * y1
    y4 = -twice * y3 - natural * y2
    return x, v, a, bound + math.sqrt(y4 * y4 / natural + y3 * y3)


@kernel
def snap_bounded_at(arc, tau, until):  # type: ignore[no-untyped-def]
    """Beam displacement, velocity, acceleration, jerk [m/s^3] at local time tau, and a bound of its |snap| [m/s^4].

    The bound holds until `until`, by the argument of `bounded_at` one derivative higher.
    """
    y, y1 = _swing(arc, tau - arc.start)
    u = arc.c0 + tau * (arc.c1 + tau * (arc.c2 + tau * arc.c3))
    rate = arc.c1 + tau * (2.0 * arc.c2 + tau * 3.0 * arc.c3)
    x = y + u + arc.w0 + arc.w1 * tau
    v = y1 + rate + arc.w1
    bound, jerk = 0.0, 6.0 * arc.c3
    if arc.a0 != 0.0 or arc.a1 != 0.0:
        angle = arc.omega * tau + arc.phase
        s, c = math.sin(angle), math.cos(angle)
        q_in = arc.q0_in + arc.q1_in * tau
        q_out = arc.q0_out + arc.q1_out * tau
        squared = arc.omega * arc.omega
        x += q_in * s + q_out * c
        v += (arc.q1_in - arc.omega * q_out) * s + (arc.q1_out + arc.omega * q_in) * c
        jerk += squared * ((arc.omega * q_out - 3.0 * arc.q1_in) * s - (arc.omega * q_in + 3.0 * arc.q1_out) * c)
        amplitude = arc.a0 + arc.a1 * tau
        u += amplitude * s
        rate += arc.a1 * s + arc.omega * amplitude * c
        envelope = math.sqrt(q_in * q_in + q_out * q_out)
        if arc.a1 != 0.0:
            envelope = (
                max(envelope, math.hypot(arc.q0_in + arc.q1_in * until, arc.q0_out + arc.q1_out * until))
                + 4.0 * math.hypot(arc.q1_in, arc.q1_out) / arc.omega
            )
        bound = squared * squared * envelope
    a = (arc.stiffness * (u - x) + arc.damping * (rate - v)) / arc.mass - arc.gravity
    natural = arc.stiffness / arc.mass
    twice = 2.0 * arc.decay
    y2 = -twice * y1 - natural * y
    y3 = -twice * y2 - natural * y1
    y4 = -twice * y3 - natural * y2
    y5 = -twice * y4 - natural * y3
    return x, v, a, jerk + y3, bound + math.sqrt(y5 * y5 / natural + y4 * y4)
