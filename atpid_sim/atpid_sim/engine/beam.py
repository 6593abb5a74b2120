# SPDX-License-Identifier: Apache-2.0
"""Motion of the beam along an arc: displacement, velocity, acceleration, and bounds of what follows.

An arc is that of one mode; where the structure has several, the further ones are in its `others`, and all that is
returned is of their sum.
"""

import cmath
import math
from typing import NamedTuple

from atpid_sim.engine.arc import other_arc
from atpid_sim.kernel import inlined, lean


@lean
def _second_remainder(z):
    """Return (e^z - 1 - z) / z^2, which does not cancel where z is small."""
    if abs(z.real) + abs(z.imag) > 0.25:
        return (cmath.exp(z) - 1.0 - z) / (z * z)
    real, imag = 1.0, 0.0  # 1 + z/3 (1 + z/4 (1 + ...))
    for n in range(13, 2, -1):
        real, imag = 1.0 + (real * z.real - imag * z.imag) / n, (real * z.imag + imag * z.real) / n
    return 0.5 * complex(real, imag)


@lean
def _grown(arc, s):
    """Amplitude and its rate close to resonance, s seconds after the start: q' = slow q + q0 + q1 s from q = 0."""
    q0, q1 = complex(arc.q0_in, arc.q0_out), complex(arc.q1_in, arc.q1_out)
    slow = complex(-arc.decay, arc.beat)
    q = s * (q0 + s * (slow * q0 + q1) * _second_remainder(slow * s))
    q_rate = slow * q + q0 + q1 * s
    return q.real, q.imag, q_rate.real, q_rate.imag


@lean
def _forced_amplitude(arc, tau):
    """Amplitude of the forced part [m], in phase with sin and with cos, and its rate [m/s], at local time tau."""
    if arc.resonant:
        return _grown(arc, tau - arc.start)
    return arc.q0_in + arc.q1_in * tau, arc.q0_out + arc.q1_out * tau, arc.q1_in, arc.q1_out


@lean
def _envelope(arc, q_in, q_out, tau, until, order):
    """Length that, times omega^order, bounds that derivative of the forced part from tau to `until` [m]."""
    if arc.resonant:
        return _growing_envelope(arc, q_in, q_out, tau, until, order)
    envelope = math.sqrt(q_in * q_in + q_out * q_out)
    if arc.a1 != 0.0:
        last = math.hypot(arc.q0_in + arc.q1_in * until, arc.q0_out + arc.q1_out * until)
        envelope = max(envelope, last) + order * math.hypot(arc.q1_in, arc.q1_out) / arc.omega
    return envelope


@lean
def _growing_envelope(arc, q_in, q_out, tau, until, order):
    """Return the same close to resonance: the amplitude grows by no more than the drive adds."""
    s, last = tau - arc.start, until - arc.start
    feed = max(
        math.hypot(arc.q0_in + arc.q1_in * s, arc.q0_out + arc.q1_out * s),
        math.hypot(arc.q0_in + arc.q1_in * last, arc.q0_out + arc.q1_out * last),
    )
    squared = arc.omega * arc.omega
    faster = max(1.0, arc.stiffness / (arc.mass * squared)) ** 2  # where the beam is faster than the tone; order <= 4
    ramp = 0.5 * order * (order - 1.0) * math.hypot(arc.q1_in, arc.q1_out) / squared
    return faster * (math.hypot(q_in, q_out) + (until - tau + order / arc.omega) * feed + ramp)


@lean
def _free_vibration(arc, s):
    """Free vibration and its velocity, s seconds after the start of the arc."""
    angle = arc.damped * s
    if arc.squared > 0.0 and angle > 1e-8:
        fade = math.exp(-arc.decay * s)
        cosine = fade * math.cos(angle)
        sine = fade * math.sin(angle) / arc.damped
    elif arc.squared < 0.0 and angle > 1.0:
        return _overdamped(arc, s)
    elif arc.squared < 0.0 and angle > 1e-8:
        fade = math.exp(-arc.decay * s)
        cosine = fade * math.cosh(angle)
        sine = fade * math.sinh(angle) / arc.damped
    else:
        cosine = math.exp(-arc.decay * s)
        sine = cosine * s
    x = arc.free * cosine + arc.free_velocity * sine
    v = -arc.decay * x - arc.free * arc.squared * sine + arc.free_velocity * cosine
    return x, v


@lean
def _overdamped(arc, s):
    """The same where overdamped, as two decays: the slow one of a very strong damper keeps its digits."""
    fast = arc.decay + arc.damped
    slow = arc.stiffness / (arc.mass * fast)
    slow_part = 0.5 * (arc.free + arc.free_velocity / arc.damped) * math.exp(-slow * s)
    fast_part = 0.5 * (arc.free - arc.free_velocity / arc.damped) * math.exp(-fast * s)
    return slow_part + fast_part, -slow * slow_part - fast * fast_part


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
    y, y1 = _free_vibration(arc, tau - arc.start)
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


@inlined
def _higher(arc, lower, low):
    """The next derivative of the free vibration from the two before it, `lower` the one before `low`."""
    return -(2.0 * arc.decay) * low - arc.stiffness / arc.mass * lower


@lean
def mode_at(arc, tau):
    """Displacement, velocity, acceleration of one mode and of its support's motion at local time tau [SI units]."""
    m = _parts(arc, tau)
    x = m.free + (m.support + arc.w0 + arc.w1 * tau) + m.x
    v = m.free_velocity + (m.support_velocity + arc.w1) + m.v
    u, w = m.support + m.u, m.support_velocity + m.w
    return x, v, (arc.stiffness * (u - x) + arc.damping * (w - v)) / arc.mass - arc.gravity, u, w


@lean
def _others_at(others, tau):
    """Displacement, velocity and acceleration of all further modes together."""
    if others is None:
        return 0.0, 0.0, 0.0
    x = v = a = 0.0
    for row in range(others.shape[0]):
        x1, v1, a1, _u, _w = mode_at(other_arc(others[row]), tau)
        x, v, a = x + x1, v + v1, a + a1
    return x, v, a


@lean
def beam_at(arc, tau):
    """Beam displacement, velocity, acceleration and support displacement, velocity at local time tau [SI units]."""
    x, v, a, u, w = mode_at(arc, tau)
    x1, v1, a1 = _others_at(arc.others, tau)
    return x + x1, v + v1, a + a1, u, w


@lean
def _bounded_mode(arc, tau, until):
    """`bounded_at` of one mode."""
    m = _parts(arc, tau)
    x, v, a = _bounded_motion(arc, tau, m)
    bound = 6.0 * abs(arc.c3)
    if m.tone:
        bound += arc.omega * arc.omega * arc.omega * _envelope(arc, m.q_in, m.q_out, tau, until, 3.0)
    y2 = _higher(arc, m.free, m.free_velocity)
    y3 = _higher(arc, m.free_velocity, y2)
    y4 = _higher(arc, y2, y3)
    return x, v, a, bound + math.sqrt(y4 * y4 / (arc.stiffness / arc.mass) + y3 * y3)


@lean
def _others_bounded(others, tau, until):
    """`bounded_at` of all further modes together: a bound of the sum is the sum of the bounds."""
    if others is None:
        return 0.0, 0.0, 0.0, 0.0
    x = v = a = bound = 0.0
    for row in range(others.shape[0]):
        x1, v1, a1, bound1 = _bounded_mode(other_arc(others[row]), tau, until)
        x, v, a, bound = x + x1, v + v1, a + a1, bound + bound1
    return x, v, a, bound


@lean
def bounded_at(arc, tau, until):
    """Beam displacement, velocity, acceleration at local time tau, and a bound of its |jerk| [m/s^3] until `until`.

    The free vibration's jerk j obeys the same damped oscillator, so j'^2 + w0^2 j^2 never grows and
    |j| <= sqrt(j'^2 / w0^2 + j^2) from there on, under-, over- or critically damped alike. The particular
    solution's jerk is bounded by its envelope, which is linear in time. docs/no_missed_impact.md has the proof.
    """
    x, v, a, bound = _bounded_mode(arc, tau, until)
    x1, v1, a1, bound1 = _others_bounded(arc.others, tau, until)
    return x + x1, v + v1, a + a1, bound + bound1


@lean
def _snap_bounded_mode(arc, tau, until):
    """`snap_bounded_at` of one mode."""
    m = _parts(arc, tau)
    x, v, a = _bounded_motion(arc, tau, m)
    squared = arc.omega * arc.omega
    bound, jerk = 0.0, 6.0 * arc.c3
    if m.tone:
        jerk += squared * (
            (arc.omega * m.q_out - 3.0 * m.rate_in) * m.sine - (arc.omega * m.q_in + 3.0 * m.rate_out) * m.cosine
        )
        bound = squared * squared * _envelope(arc, m.q_in, m.q_out, tau, until, 4.0)
    y2 = _higher(arc, m.free, m.free_velocity)
    y3 = _higher(arc, m.free_velocity, y2)
    y4 = _higher(arc, y2, y3)
    y5 = _higher(arc, y3, y4)
    jerk += y3
    if arc.resonant:  # the growing amplitude has higher derivatives too: take the jerk from the beam's equation
        w = m.support_velocity + m.w
        tone = 2.0 * arc.a1 * arc.omega * m.cosine - squared * m.amplitude * m.sine
        jerk = (arc.stiffness * (w - v) + arc.damping * (2.0 * arc.c2 + 6.0 * arc.c3 * tau + tone - a)) / arc.mass
    return x, v, a, jerk, bound + math.sqrt(y5 * y5 / (arc.stiffness / arc.mass) + y4 * y4)


@lean
def _others_snap_bounded(others, tau, until):
    """`snap_bounded_at` of all further modes together."""
    if others is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    x = v = a = jerk = bound = 0.0
    for row in range(others.shape[0]):
        x1, v1, a1, jerk1, bound1 = _snap_bounded_mode(other_arc(others[row]), tau, until)
        x, v, a, jerk, bound = x + x1, v + v1, a + a1, jerk + jerk1, bound + bound1
    return x, v, a, jerk, bound


@lean
def snap_bounded_at(arc, tau, until):
    """Beam displacement, velocity, acceleration, jerk [m/s^3] at local time tau, and a bound of its |snap| [m/s^4].

    The bound holds until `until`, by the argument of `bounded_at` one derivative higher.
    """
    x, v, a, jerk, bound = _snap_bounded_mode(arc, tau, until)
    x1, v1, a1, jerk1, bound1 = _others_snap_bounded(arc.others, tau, until)
    return x + x1, v + v1, a + a1, jerk + jerk1, bound + bound1


@lean
def _fastest_other(others):
    """Highest angular frequency of the further modes [rad/s]."""
    if others is None:
        return 0.0
    highest = 0.0
    for row in range(others.shape[0]):
        arc = other_arc(others[row])
        highest = max(highest, arc.stiffness / arc.mass)
    return math.sqrt(highest)


@lean
def fastest_of(arc):
    """Highest angular frequency of the tone and of all modes [rad/s]."""
    tone = arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0
    return max(tone, math.sqrt(arc.stiffness / arc.mass), _fastest_other(arc.others))
