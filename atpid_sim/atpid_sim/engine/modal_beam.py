# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of a structure of several modes along a `modal_arc.ModalArc`, and bounds of what follows.

What `beam` returns where an arc is of several modes; the first argument of these functions is the arc's `modes`.
"""

import cmath
import math

from atpid_sim.engine.modal_arc import FAST, STILL, Fast, mode_arc
from atpid_sim.engine.vibration import free_vibration, growing_envelope, grown, higher
from atpid_sim.kernel import inlined, kernel


@inlined
def _cubic(arc, tau):
    """What is no vibration: displacement, velocity, acceleration."""
    x = arc.p0 + tau * (arc.p1 + tau * (arc.p2 + tau * arc.p3))
    return x, arc.p1 + tau * (2.0 * arc.p2 + tau * 3.0 * arc.p3), 2.0 * arc.p2 + 6.0 * tau * arc.p3


@inlined
def _driven(arc, tau):
    """What is no free vibration: displacement, velocity, acceleration, and amplitude of the answer to the tone [m]."""
    x, v, a = _cubic(arc, tau)
    q = complex(0.0, 0.0)
    if arc.tone:
        q, q1, q2, _q3, turn = _answer(arc, tau)
        rate = q1 + complex(0.0, arc.omega) * q
        x += (q * turn).imag
        v += (rate * turn).imag
        a += ((q2 + complex(0.0, arc.omega) * (q1 + rate)) * turn).imag
    return x, v, a, q


@kernel
def _answer(arc, tau):
    """Amplitude of the answer to the tone and its first three derivatives [m/s^k], complex, and the tone's phase."""
    turn = cmath.exp(complex(0.0, arc.omega * tau + arc.phase))
    q, q1 = arc.q0 + tau * arc.q1, arc.q1
    q2 = q3 = complex(0.0, 0.0)
    if arc.growing:
        for i in range(arc.modes.shape[1]):
            mode = mode_arc(arc.modes, i)
            if mode.resonant:
                q_in, q_out, rate_in, rate_out = grown(mode, tau - arc.start)
                slow, rate = complex(-mode.decay, mode.beat), complex(rate_in, rate_out)
                second = slow * rate + complex(mode.q1_in, mode.q1_out)
                q, q1, q2, q3 = q + complex(q_in, q_out), q1 + rate, q2 + second, q3 + slow * second
    return q, q1, q2, q3, turn


@kernel
def _envelope(arc, q, tau, until, order):
    """Length that, times omega^order, bounds that derivative of the answer to the tone from tau to `until` [m]."""
    size = 0.0
    if arc.growing:
        for i in range(arc.modes.shape[1]):
            mode = mode_arc(arc.modes, i)
            if mode.resonant:
                q_in, q_out, _rate, _rate_out = grown(mode, tau - arc.start)
                q -= complex(q_in, q_out)
                size += growing_envelope(mode, q_in, q_out, tau, until, order)
    steady = math.sqrt(q.real * q.real + q.imag * q.imag)
    if arc.q1 != 0.0:
        steady = max(steady, abs(arc.q0 + until * arc.q1)) + order * abs(arc.q1) / arc.omega
    return size + steady


def modal_at(modes, arc, tau):
    """`beam.beam_at`."""
    x, v, a, _q = _driven(arc, tau)
    for i in range(modes.shape[1]):
        mode = mode_arc(modes, i)
        y, y1 = free_vibration(mode, tau - arc.start)
        x, v, a = x + y, v + y1, a + higher(mode, y, y1)
    return x, v, a, math.nan, math.nan


def modal_bounded(modes, arc, tau, until):
    """`beam.bounded_at`: the bound of a sum is the sum of the bounds; and `modal_arc.Fast`."""
    x, v, a, q = _driven(arc, tau)
    bound = 6.0 * abs(arc.p3)
    if arc.tone:
        bound += arc.omega * arc.omega * arc.omega * _envelope(arc, q, tau, until, 3.0)
    fast_x = fast_v = fast_a = fast_bound = size = 0.0
    limit = FAST * FAST * arc.pace * arc.pace
    for i in range(modes.shape[1]):
        mode = mode_arc(modes, i)
        y, y1 = free_vibration(mode, tau - arc.start)
        natural = mode.stiffness / mode.mass
        y2 = higher(mode, y, y1)
        y3 = higher(mode, y1, y2)
        y4 = higher(mode, y2, y3)
        own = math.sqrt(y4 * y4 / natural + y3 * y3)
        x, v, a, bound = x + y, v + y1, a + y2, bound + own
        if natural > limit:
            fast_x, fast_v, fast_a, fast_bound = fast_x + y, fast_v + y1, fast_a + y2, fast_bound + own
            size += math.sqrt(y * y + y1 * y1 / natural)
    return x, v, a, bound, Fast(fast_x, fast_v, fast_a, fast_bound, size)


def modal_snap_bounded(modes, arc, tau, until):
    """`beam.snap_bounded_at`."""
    x, v, a = _cubic(arc, tau)
    jerk, bound = 6.0 * arc.p3, 0.0
    if arc.tone:
        q, q1, q2, q3, turn = _answer(arc, tau)
        turning, squared = complex(0.0, arc.omega), arc.omega * arc.omega
        x += (q * turn).imag
        v += ((q1 + turning * q) * turn).imag
        a += ((q2 + 2.0 * turning * q1 - squared * q) * turn).imag
        jerk += ((q3 + 3.0 * turning * q2 - 3.0 * squared * q1 - squared * turning * q) * turn).imag
        bound += squared * squared * _envelope(arc, q, tau, until, 4.0)
    for i in range(modes.shape[1]):
        mode = mode_arc(modes, i)
        y, y1 = free_vibration(mode, tau - arc.start)
        y2 = higher(mode, y, y1)
        y3 = higher(mode, y1, y2)
        y4 = higher(mode, y2, y3)
        y5 = higher(mode, y3, y4)
        x, v, a, jerk = x + y, v + y1, a + y2, jerk + y3
        bound += math.sqrt(y5 * y5 / (mode.stiffness / mode.mass) + y4 * y4)
    return x, v, a, jerk, bound


def modal_pace(modes, arc):
    """`beam.fastest_of`."""
    fastest = arc.omega if arc.tone else 0.0
    for i in range(modes.shape[1]):
        mode = mode_arc(modes, i)
        fastest = max(fastest, math.sqrt(mode.stiffness / mode.mass))
    return fastest


@kernel
def turning_pace(arc, observing):
    """Highest angular frequency [rad/s] with which the container may turn so that it matters.

    Where it is not observed, that of the tone or of the first mode.
    """
    if not observing:
        return arc.pace
    total, pace = abs(arc.q0), arc.pace
    for i in range(arc.modes.shape[1]):
        total += _size(mode_arc(arc.modes, i))
    for i in range(arc.modes.shape[1]):
        mode = mode_arc(arc.modes, i)
        if _size(mode) > STILL * total:
            pace = max(pace, math.sqrt(mode.stiffness / mode.mass))
    return pace


@inlined
def _size(mode):
    """About the size of a free vibration at its begin [m]."""
    return abs(mode.free) + abs(mode.free_velocity) / math.sqrt(mode.stiffness / mode.mass)


@kernel
def mode_at(mode, phase, tau):
    """Displacement and velocity of one mode (`mode_arc`) at local time tau; phase: of the tone at tau = 0 [rad]."""
    x, v = free_vibration(mode, tau - mode.start)
    x += mode.p0 + tau * (mode.p1 + tau * (mode.p2 + tau * mode.p3))
    v += mode.p1 + tau * (2.0 * mode.p2 + tau * 3.0 * mode.p3)
    if mode.resonant:
        q_in, q_out, rate_in, rate_out = grown(mode, tau - mode.start)
    else:
        rate_in, rate_out = mode.q1_in, mode.q1_out
        q_in, q_out = mode.q0_in + tau * rate_in, mode.q0_out + tau * rate_out
    if q_in != 0.0 or q_out != 0.0 or rate_in != 0.0 or rate_out != 0.0:
        angle = mode.omega * tau + phase
        s, c = math.sin(angle), math.cos(angle)
        x += q_in * s + q_out * c
        v += (rate_in - mode.omega * q_out) * s + (rate_out + mode.omega * q_in) * c
    return x, v
