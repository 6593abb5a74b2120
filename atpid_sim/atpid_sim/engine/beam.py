# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of the beam along an arc: displacement, velocity, acceleration, and bounds of what follows.

An arc is an `arc.Arc`; where the structure has several modes a `modal_arc.ModalArc`, and `modal_beam` has the motion.
"""

import math
from typing import NamedTuple

from atpid_sim.engine.modal_beam import modal_at, modal_bounded, modal_pace, modal_snap_bounded
from atpid_sim.engine.vibration import free_vibration, growing_envelope, grown, higher
from atpid_sim.kernel import chosen, inlined, kernel


@kernel
def _forced_amplitude(arc, tau):
    """Amplitude of the forced part [m], in phase with sin and with cos, and its rate [m/s], at local time tau."""
    if arc.resonant:
        return grown(arc, tau - arc.start)
    return arc.q0_in + arc.q1_in * tau, arc.q0_out + arc.q1_out * tau, arc.q1_in, arc.q1_out


@kernel
def _envelope(arc, q_in, q_out, tau, until, order):
    """Length that, times omega^order, bounds that derivative of the forced part from tau to `until` [m]."""
    if arc.resonant:
        return growing_envelope(arc, q_in, q_out, tau, until, order)
    envelope = math.sqrt(q_in * q_in + q_out * q_out)
    if arc.a1 != 0.0:
        last = math.hypot(arc.q0_in + arc.q1_in * until, arc.q0_out + arc.q1_out * until)
        envelope = max(envelope, last) + order * math.hypot(arc.q1_in, arc.q1_out) / arc.omega
    return envelope


class _Parts(NamedTuple):
    """What displacement, velocity and their bounds at one instant are made of [SI units]."""

    free: float  # free vibration
    free_velocity: float
    support: float  # polynomial part of the support's motion
    support_velocity: float
    tone: bool  # whether the support's motion has a tone; all below are zero without
    sine: float
    cosine: float
    amplitude: float
    q_in: float
    q_out: float
    rate_in: float
    rate_out: float
    x: float  # the tone's part of the beam's motion
    v: float
    u: float  # and of the support's
    w: float


@inlined
def _parts(arc, tau):
    """What the motion at local time tau is made of."""
    y, y1 = free_vibration(arc, tau - arc.start)
    u = arc.c0 + tau * (arc.c1 + tau * (arc.c2 + tau * arc.c3))
    w = arc.c1 + tau * (2.0 * arc.c2 + tau * 3.0 * arc.c3)
    if arc.a0 == 0.0 and arc.a1 == 0.0:
        return _Parts(y, y1, u, w, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    angle = arc.omega * tau + arc.phase
    s, c = math.sin(angle), math.cos(angle)
    q_in, q_out, rate_in, rate_out = _forced_amplitude(arc, tau)
    amplitude = arc.a0 + arc.a1 * tau
    return _Parts(
        y, y1, u, w, True, s, c, amplitude, q_in, q_out, rate_in, rate_out,
        q_in * s + q_out * c, (rate_in - arc.omega * q_out) * s + (rate_out + arc.omega * q_in) * c,
        amplitude * s, arc.a1 * s + arc.omega * amplitude * c,
    )  # fmt: skip


@inlined
def _bounded_motion(arc, tau, m):
    """Beam displacement, velocity and acceleration from its parts, summed as the bounds' proof has it."""
    x = m.free + m.support + arc.w0 + arc.w1 * tau + m.x
    v = m.free_velocity + m.support_velocity + arc.w1 + m.v
    u, w = m.support + m.u, m.support_velocity + m.w
    return x, v, (arc.stiffness * (u - x) + arc.damping * (w - v)) / arc.mass - arc.gravity


def _one_at(modes, arc, tau):
    m = _parts(arc, tau)
    x = m.free + (m.support + arc.w0 + arc.w1 * tau) + m.x
    v = m.free_velocity + (m.support_velocity + arc.w1) + m.v
    u, w = m.support + m.u, m.support_velocity + m.w
    return x, v, (arc.stiffness * (u - x) + arc.damping * (w - v)) / arc.mass - arc.gravity, u, w


def _one_bounded(modes, arc, tau, until):
    m = _parts(arc, tau)
    x, v, a = _bounded_motion(arc, tau, m)
    bound = 6.0 * abs(arc.c3)
    if m.tone:
        bound += arc.omega * arc.omega * arc.omega * _envelope(arc, m.q_in, m.q_out, tau, until, 3.0)
    y2 = higher(arc, m.free, m.free_velocity)
    y3 = higher(arc, m.free_velocity, y2)
    y4 = higher(arc, y2, y3)
    return x, v, a, bound + math.sqrt(y4 * y4 / (arc.stiffness / arc.mass) + y3 * y3), None


def _one_snap_bounded(modes, arc, tau, until):
    m = _parts(arc, tau)
    x, v, a = _bounded_motion(arc, tau, m)
    squared = arc.omega * arc.omega
    bound, jerk = 0.0, 6.0 * arc.c3
    if m.tone:
        jerk += squared * (
            (arc.omega * m.q_out - 3.0 * m.rate_in) * m.sine - (arc.omega * m.q_in + 3.0 * m.rate_out) * m.cosine
        )
        bound = squared * squared * _envelope(arc, m.q_in, m.q_out, tau, until, 4.0)
    y2 = higher(arc, m.free, m.free_velocity)
    y3 = higher(arc, m.free_velocity, y2)
    y4 = higher(arc, y2, y3)
    y5 = higher(arc, y3, y4)
    jerk += y3
    if arc.resonant:  # the growing amplitude has higher derivatives too: take the jerk from the beam's equation
        w = m.support_velocity + m.w
        tone = 2.0 * arc.a1 * arc.omega * m.cosine - squared * m.amplitude * m.sine
        jerk = (arc.stiffness * (w - v) + arc.damping * (2.0 * arc.c2 + 6.0 * arc.c3 * tau + tone - a)) / arc.mass
    return x, v, a, jerk, bound + math.sqrt(y5 * y5 / (arc.stiffness / arc.mass) + y4 * y4)


def _one_pace(modes, arc):
    tone = arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0
    return max(tone, math.sqrt(arc.stiffness / arc.mass))


_at = chosen(_one_at, modal_at)
_bounded = chosen(_one_bounded, modal_bounded)
_snap_bounded = chosen(_one_snap_bounded, modal_snap_bounded)
_pace = chosen(_one_pace, modal_pace)


@kernel
def beam_at(arc, tau):
    """Beam displacement, velocity, acceleration and support displacement, velocity at local time tau [SI units].

    Of several modes those of the support are not known, and not a number.
    """
    return _at(arc.modes, arc, tau)


@kernel
def bounded_at(arc, tau, until):
    """Beam displacement, velocity, acceleration at local time tau, and a bound of its |jerk| [m/s^3] until `until`.

    The free vibration's jerk j obeys the same damped oscillator, so j'^2 + w0^2 j^2 never grows and
    |j| <= sqrt(j'^2 / w0^2 + j^2) from there on, under-, over- or critically damped alike. The particular
    solution's jerk is bounded by its envelope, which is linear in time (docs/research/no_missed_impact.md).
    The last value is None, or of several modes `modal_beam.Fast`.
    """
    return _bounded(arc.modes, arc, tau, until)


@kernel
def snap_bounded_at(arc, tau, until):
    """Beam displacement, velocity, acceleration, jerk [m/s^3] at local time tau, and a bound of its |snap| [m/s^4].

    The bound holds until `until`, by the argument of `bounded_at` one derivative higher.
    """
    return _snap_bounded(arc.modes, arc, tau, until)


@kernel
def fastest_of(arc):
    """Highest angular frequency of the tone and of all modes [rad/s]."""
    return _pace(arc.modes, arc)
