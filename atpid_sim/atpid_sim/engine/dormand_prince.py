# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One explicit step of a contact by the method of Dormand and Prince, order 5(4).

The state is beam displacement and velocity, overlap and overlap velocity, so that an overlap of micrometres on a
displacement of decimetres keeps its digits. `rosenbrock.py` has the implicit step for static contact.
"""

from typing import NamedTuple

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.columns import A0, A1, C0, C1, C2, C3, OMEGA
from atpid_sim.kernel import inlined, kernel
from atpid_sim.system import Array


class ContactModel(NamedTuple):
    """What is constant during one contact inside one row, but for the memory of a hysteretic law [SI units]."""

    law: int
    hysteretic: bool
    memory: float  # deepest overlap so far
    side: float  # +1 floor, -1 ceiling
    stiffness: float
    damping: float
    gravity: float
    beam_inverse: float  # 1 / beam mass
    reduced_inverse: float  # 1 / beam mass + 1 / grain mass
    modes: Array | None  # `modal.Modes.table` of a structure of several, else None


class Moment(NamedTuple):
    """Start of a step: local time [s], the method's own variable, and sine and cosine of the support's phase."""

    tau: float
    s: float
    sine: float
    cosine: float


class Rates(NamedTuple):
    """Accelerations, force and powers at one instant of a contact [SI units]."""

    beam_acceleration: float
    overlap_acceleration: float
    force: float
    support_power: float  # without that of the term stiffness u u', whose integral is known
    damper_power: float
    contact_power: float  # of the damping part of the contact force alone


class ContactState(NamedTuple):
    """Beam and overlap at one instant of a contact [SI units]."""

    x: float
    v: float
    overlap: float
    velocity: float  # of the overlap
    rates: Rates
    end: int | None  # of a structure of several `modal_step.end_of`, else None


class Errors(NamedTuple):
    """Estimated errors of a step in the four states [SI units]."""

    x: float
    v: float
    overlap: float
    velocity: float


class Flows(NamedTuple):
    """Integrals over a step: energy to contact damping, from the support, to the beam's damper [J]; impulse [N s]."""

    contact: float
    support: float
    damper: float
    impulse: float


@inlined
def _turn(angle):
    """Sine and cosine of an angle below 0.2 rad, by their series to the last digit."""
    q = angle * angle
    sine = angle * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q * (1.0 / 362880.0)))))
    cosine = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q * (1.0 / 40320.0 - q * (1.0 / 3628800.0)))))
    return sine, cosine


@inlined
def support_ahead(segment, tau, ahead, sine, cosine):
    """Support displacement and velocity `ahead` seconds after tau, whose phase has this sine and cosine."""
    at = tau + ahead
    u = segment[C0] + at * (segment[C1] + at * (segment[C2] + at * segment[C3]))
    w = segment[C1] + at * (2.0 * segment[C2] + at * 3.0 * segment[C3])
    ds, dc = _turn(segment[OMEGA] * ahead)
    s = sine * dc + cosine * ds
    c = cosine * dc - sine * ds
    amplitude = segment[A0] + segment[A1] * at
    return u + amplitude * s, w + segment[A1] * s + segment[OMEGA] * amplitude * c


@inlined
def rates_at(model, p, u, w, x, v, overlap, velocity):
    """`Rates` at one stage, with the support at u and its velocity w.

    The contact's power is that of its damping part: the elastic part stores and returns its energy exactly. The
    support's omits stiffness u u', whose integral is known and can be a million times the rest.
    """
    slip = v - w
    pull = model.stiffness * (u - x) - model.damping * slip
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    return Rates(
        (pull - model.side * push) * model.beam_inverse - model.gravity,
        model.side * pull * model.beam_inverse - push * model.reduced_inverse,
        push,
        (pull - model.stiffness * u) * w,
        model.damping * slip * slip,
        (push - elastic) * velocity,
    )


@kernel
def explicit_step(segment, model, p, smooth, moment, h, motion):
    """One Dormand-Prince step of size h in the variable s; time goes as s^4 if `smooth`.

    Returns `ContactState` at the end, `Errors` and `Flows`.
    """
    tau, s, sine, cosine = moment
    x, v, overlap, velocity, k, _modes = motion
    a1, b1, f1, p1, d1, c1 = k
    if smooth:
        s2, s3, s4, s5, s6 = s + 0.2 * h, s + 0.3 * h, s + 0.8 * h, s + 8.0 / 9.0 * h, s + h
        z2, z3, z4, z5, z6 = s2 * s2 * s2, s3 * s3 * s3, s4 * s4 * s4, s5 * s5 * s5, s6 * s6 * s6
        w1, w2, w3 = 4.0 * h * s * s * s, 4.0 * h * z2, 4.0 * h * z3
        w4, w5, w6 = 4.0 * h * z4, 4.0 * h * z5, 4.0 * h * z6
        past = s * s * s * s
        t2, t3, t4, t5, t6 = z2 * s2 - past, z3 * s3 - past, z4 * s4 - past, z5 * s5 - past, z6 * s6 - past
    else:
        w1 = w2 = w3 = w4 = w5 = w6 = h
        t2, t3, t4, t5, t6 = 0.2 * h, 0.3 * h, 0.8 * h, 8.0 / 9.0 * h, h
    u2, m2 = support_ahead(segment, tau, t2, sine, cosine)
    u3, m3 = support_ahead(segment, tau, t3, sine, cosine)
    u4, m4 = support_ahead(segment, tau, t4, sine, cosine)
    u5, m5 = support_ahead(segment, tau, t5, sine, cosine)
    u6, m6 = support_ahead(segment, tau, t6, sine, cosine)
    # stage slopes already multiplied by the step: x, v, overlap, rate
    kx1, kv1, ko1, kr1 = w1 * v, w1 * a1, w1 * velocity, w1 * b1
    v2, r2 = v + 0.2 * kv1, velocity + 0.2 * kr1
    a2, b2, _f, _p, _d, _c = rates_at(model, p, u2, m2, x + 0.2 * kx1, v2, overlap + 0.2 * ko1, r2)
    kx2, kv2, ko2, kr2 = w2 * v2, w2 * a2, w2 * r2, w2 * b2
    v3, r3 = v + 3.0 / 40.0 * kv1 + 9.0 / 40.0 * kv2, velocity + 3.0 / 40.0 * kr1 + 9.0 / 40.0 * kr2
    x3, o3 = x + 3.0 / 40.0 * kx1 + 9.0 / 40.0 * kx2, overlap + 3.0 / 40.0 * ko1 + 9.0 / 40.0 * ko2
    a3, b3, f3, p3, d3, c3 = rates_at(model, p, u3, m3, x3, v3, o3, r3)
    kx3, kv3, ko3, kr3 = w3 * v3, w3 * a3, w3 * r3, w3 * b3
    v4 = v + 44.0 / 45.0 * kv1 - 56.0 / 15.0 * kv2 + 32.0 / 9.0 * kv3
    r4 = velocity + 44.0 / 45.0 * kr1 - 56.0 / 15.0 * kr2 + 32.0 / 9.0 * kr3
    x4 = x + 44.0 / 45.0 * kx1 - 56.0 / 15.0 * kx2 + 32.0 / 9.0 * kx3
    o4 = overlap + 44.0 / 45.0 * ko1 - 56.0 / 15.0 * ko2 + 32.0 / 9.0 * ko3
    a4, b4, f4, p4, d4, c4 = rates_at(model, p, u4, m4, x4, v4, o4, r4)
    kx4, kv4, ko4, kr4 = w4 * v4, w4 * a4, w4 * r4, w4 * b4
    c51, c52, c53, c54 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    v5 = v + c51 * kv1 + c52 * kv2 + c53 * kv3 + c54 * kv4
    r5 = velocity + c51 * kr1 + c52 * kr2 + c53 * kr3 + c54 * kr4
    x5 = x + c51 * kx1 + c52 * kx2 + c53 * kx3 + c54 * kx4
    o5 = overlap + c51 * ko1 + c52 * ko2 + c53 * ko3 + c54 * ko4
    a5, b5, f5, p5, d5, c5 = rates_at(model, p, u5, m5, x5, v5, o5, r5)
    kx5, kv5, ko5, kr5 = w5 * v5, w5 * a5, w5 * r5, w5 * b5
    c61, c62, c63, c64, c65 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
    v6 = v + c61 * kv1 + c62 * kv2 + c63 * kv3 + c64 * kv4 + c65 * kv5
    r6 = velocity + c61 * kr1 + c62 * kr2 + c63 * kr3 + c64 * kr4 + c65 * kr5
    x6 = x + c61 * kx1 + c62 * kx2 + c63 * kx3 + c64 * kx4 + c65 * kx5
    o6 = overlap + c61 * ko1 + c62 * ko2 + c63 * ko3 + c64 * ko4 + c65 * ko5
    a6, b6, f6, p6, d6, c6 = rates_at(model, p, u6, m6, x6, v6, o6, r6)
    kx6, kv6, ko6, kr6 = w6 * v6, w6 * a6, w6 * r6, w6 * b6
    g1, g3, g4, g5, g6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    x1 = x + g1 * kx1 + g3 * kx3 + g4 * kx4 + g5 * kx5 + g6 * kx6
    v1 = v + g1 * kv1 + g3 * kv3 + g4 * kv4 + g5 * kv5 + g6 * kv6
    o1 = overlap + g1 * ko1 + g3 * ko3 + g4 * ko4 + g5 * ko5 + g6 * ko6
    r1 = velocity + g1 * kr1 + g3 * kr3 + g4 * kr4 + g5 * kr5 + g6 * kr6
    last = rates_at(model, p, u6, m6, x1, v1, o1, r1)
    e1, e3, e4, e5, e6, e7 = 71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025
    errors = Errors(
        e1 * kx1 + e3 * kx3 + e4 * kx4 + e5 * kx5 + e6 * kx6 + e7 * w6 * v1,
        e1 * kv1 + e3 * kv3 + e4 * kv4 + e5 * kv5 + e6 * kv6 + e7 * w6 * last.beam_acceleration,
        e1 * ko1 + e3 * ko3 + e4 * ko4 + e5 * ko5 + e6 * ko6 + e7 * w6 * r1,
        e1 * kr1 + e3 * kr3 + e4 * kr4 + e5 * kr5 + e6 * kr6 + e7 * w6 * last.overlap_acceleration,
    )
    absorbed = g1 * w1 * c1 + g3 * w3 * c3 + g4 * w4 * c4 + g5 * w5 * c5 + g6 * w6 * c6
    work = g1 * w1 * p1 + g3 * w3 * p3 + g4 * w4 * p4 + g5 * w5 * p5 + g6 * w6 * p6
    loss = g1 * w1 * d1 + g3 * w3 * d3 + g4 * w4 * d4 + g5 * w5 * d5 + g6 * w6 * d6
    impulse = g1 * w1 * f1 + g3 * w3 * f3 + g4 * w4 * f4 + g5 * w5 * f5 + g6 * w6 * f6
    return ContactState(x1, v1, o1, r1, last, None), errors, Flows(absorbed, work, loss, impulse)
