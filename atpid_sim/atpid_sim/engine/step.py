# SPDX-License-Identifier: Apache-2.0
"""One step of a contact: an explicit Dormand-Prince 5(4) for the impact itself.

The state is beam displacement and velocity, overlap and overlap rate, so that an overlap of micrometres on a swing of
decimetres keeps its digits. `rest.py` has the implicit step for a grain that rests.
"""

from __future__ import annotations

from typing import NamedTuple

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.kernel import inlined, kernel


class Touch(NamedTuple):
    """What does not change during one contact inside one row [SI units]."""

    law: int
    hysteretic: bool
    memory: float
    side: float  # +1 floor, -1 ceiling
    stiffness: float
    damping: float
    gravity: float
    beam_inverse: float  # 1 / beam mass
    reduced_inverse: float  # 1 / beam mass + 1 / grain mass


class Moment(NamedTuple):
    """Where a step begins: local time [s], the method's own variable, and sine and cosine of the support's phase."""

    tau: float
    s: float
    sine: float
    cosine: float


class Motion(NamedTuple):
    """Beam and overlap in contact, with what `slope` says of them there [SI units]."""

    x: float
    v: float
    overlap: float
    rate: float
    slope: tuple[float, float, float, float, float, float]


@inlined
def _turn(angle):  # type: ignore[no-untyped-def]
    """Sine and cosine of an angle below 0.2 rad, by their series to the last digit."""
    q = angle * angle
    sine = angle * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q * (1.0 / 362880.0)))))
    cosine = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q * (1.0 / 40320.0 - q * (1.0 / 3628800.0)))))
    return sine, cosine


@inlined
def support_ahead(segment, tau, ahead, sine, cosine):  # type: ignore[no-untyped-def]
    """Support displacement and velocity `ahead` seconds after tau, whose phase has this sine and cosine."""
    at = tau + ahead
    u = segment[6] + at * (segment[7] + at * (segment[8] + at * segment[9]))
    w = segment[7] + at * (2.0 * segment[8] + at * 3.0 * segment[9])
    ds, dc = _turn(segment[4] * ahead)
    s = sine * dc + cosine * ds
    c = cosine * dc - sine * ds
    amplitude = segment[2] + segment[3] * at
    return u + amplitude * s, w + segment[3] * s + segment[4] * amplitude * c


@inlined
def slope(touching, p, u, w, x, v, overlap, rate):  # type: ignore[no-untyped-def]
    """Accelerations of beam and overlap, contact force, powers of support, beam damper and contact at one stage.

    The contact's power is that of its damping part alone: what the elastic part takes it gives back, exactly. The
    support's is without stiffness u u', whose integral is known: it can be a million times the rest.
    """
    slip = v - w
    pull = touching.stiffness * (u - x) - touching.damping * slip
    push = force(touching.law, overlap, rate, touching.memory, p)
    elastic = 0.0 if touching.hysteretic else force(touching.law, overlap, 0.0, touching.memory, p)
    return (
        (pull - touching.side * push) * touching.beam_inverse - touching.gravity,
        touching.side * pull * touching.beam_inverse - push * touching.reduced_inverse,
        push,
        (pull - touching.stiffness * u) * w,
        touching.damping * slip * slip,
        (push - elastic) * rate,
    )


@kernel
def explicit_step(segment, touching, p, smooth, moment, h, motion):  # type: ignore[no-untyped-def]
    """One Dormand-Prince step of size h in the variable s; time goes as s^4 if `smooth`.

    Returns the motion at the end, the error estimate of its four states, and the integrals of the powers of contact,
    support and beam damper and of the force.
    """
    tau, s, sine, cosine = moment
    x, v, overlap, rate, k = motion
    a1, b1, f1, p1, d1, c1 = k
    if smooth:
        s2, s3, s4, s5, s6 = s + 0.2 * h, s + 0.3 * h, s + 0.8 * h, s + 8.0 / 9.0 * h, s + h
        z2, z3, z4, z5, z6 = s2 * s2 * s2, s3 * s3 * s3, s4 * s4 * s4, s5 * s5 * s5, s6 * s6 * s6
        w1, w2, w3, w4, w5, w6 = (
            4.0 * h * s * s * s,
            4.0 * h * z2,
            4.0 * h * z3,
            4.0 * h * z4,
            4.0 * h * z5,
            4.0 * h * z6,
        )
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
    kx1, kv1, ko1, kr1 = w1 * v, w1 * a1, w1 * rate, w1 * b1
    v2, r2 = v + 0.2 * kv1, rate + 0.2 * kr1
    a2, b2, _f, _p, _d, _c = slope(touching, p, u2, m2, x + 0.2 * kx1, v2, overlap + 0.2 * ko1, r2)
    kx2, kv2, ko2, kr2 = w2 * v2, w2 * a2, w2 * r2, w2 * b2
    v3, r3 = v + 3.0 / 40.0 * kv1 + 9.0 / 40.0 * kv2, rate + 3.0 / 40.0 * kr1 + 9.0 / 40.0 * kr2
    a3, b3, f3, p3, d3, c3 = slope(
        touching, p, u3, m3,
        x + 3.0 / 40.0 * kx1 + 9.0 / 40.0 * kx2, v3, overlap + 3.0 / 40.0 * ko1 + 9.0 / 40.0 * ko2, r3,
    )  # fmt: skip
    kx3, kv3, ko3, kr3 = w3 * v3, w3 * a3, w3 * r3, w3 * b3
    v4 = v + 44.0 / 45.0 * kv1 - 56.0 / 15.0 * kv2 + 32.0 / 9.0 * kv3
    r4 = rate + 44.0 / 45.0 * kr1 - 56.0 / 15.0 * kr2 + 32.0 / 9.0 * kr3
    a4, b4, f4, p4, d4, c4 = slope(
        touching, p, u4, m4,
        x + 44.0 / 45.0 * kx1 - 56.0 / 15.0 * kx2 + 32.0 / 9.0 * kx3, v4,
        overlap + 44.0 / 45.0 * ko1 - 56.0 / 15.0 * ko2 + 32.0 / 9.0 * ko3, r4,
    )  # fmt: skip
    kx4, kv4, ko4, kr4 = w4 * v4, w4 * a4, w4 * r4, w4 * b4
    c51, c52, c53, c54 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    v5 = v + c51 * kv1 + c52 * kv2 + c53 * kv3 + c54 * kv4
    r5 = rate + c51 * kr1 + c52 * kr2 + c53 * kr3 + c54 * kr4
    a5, b5, f5, p5, d5, c5 = slope(
        touching, p, u5, m5,
        x + c51 * kx1 + c52 * kx2 + c53 * kx3 + c54 * kx4, v5,
        overlap + c51 * ko1 + c52 * ko2 + c53 * ko3 + c54 * ko4, r5,
    )  # fmt: skip
    kx5, kv5, ko5, kr5 = w5 * v5, w5 * a5, w5 * r5, w5 * b5
    c61, c62, c63, c64, c65 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
    v6 = v + c61 * kv1 + c62 * kv2 + c63 * kv3 + c64 * kv4 + c65 * kv5
    r6 = rate + c61 * kr1 + c62 * kr2 + c63 * kr3 + c64 * kr4 + c65 * kr5
    a6, b6, f6, p6, d6, c6 = slope(
        touching, p, u6, m6,
        x + c61 * kx1 + c62 * kx2 + c63 * kx3 + c64 * kx4 + c65 * kx5, v6,
        overlap + c61 * ko1 + c62 * ko2 + c63 * ko3 + c64 * ko4 + c65 * ko5, r6,
    )  # fmt: skip
    kx6, kv6, ko6, kr6 = w6 * v6, w6 * a6, w6 * r6, w6 * b6
    g1, g3, g4, g5, g6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    x1 = x + g1 * kx1 + g3 * kx3 + g4 * kx4 + g5 * kx5 + g6 * kx6
    v1 = v + g1 * kv1 + g3 * kv3 + g4 * kv4 + g5 * kv5 + g6 * kv6
    o1 = overlap + g1 * ko1 + g3 * ko3 + g4 * ko4 + g5 * ko5 + g6 * ko6
    r1 = rate + g1 * kr1 + g3 * kr3 + g4 * kr4 + g5 * kr5 + g6 * kr6
    last = slope(touching, p, u6, m6, x1, v1, o1, r1)
    e1, e3, e4, e5, e6, e7 = 71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025
    errors = (
        e1 * kx1 + e3 * kx3 + e4 * kx4 + e5 * kx5 + e6 * kx6 + e7 * w6 * v1,
        e1 * kv1 + e3 * kv3 + e4 * kv4 + e5 * kv5 + e6 * kv6 + e7 * w6 * last[0],
        e1 * ko1 + e3 * ko3 + e4 * ko4 + e5 * ko5 + e6 * ko6 + e7 * w6 * r1,
        e1 * kr1 + e3 * kr3 + e4 * kr4 + e5 * kr5 + e6 * kr6 + e7 * w6 * last[1],
    )
    absorbed = g1 * w1 * c1 + g3 * w3 * c3 + g4 * w4 * c4 + g5 * w5 * c5 + g6 * w6 * c6
    work = g1 * w1 * p1 + g3 * w3 * p3 + g4 * w4 * p4 + g5 * w5 * p5 + g6 * w6 * p6
    loss = g1 * w1 * d1 + g3 * w3 * d3 + g4 * w4 * d4 + g5 * w5 * d5 + g6 * w6 * d6
    impulse = g1 * w1 * f1 + g3 * w3 * f3 + g4 * w4 * f4 + g5 * w5 * f5 + g6 * w6 * f6
    return Motion(x1, v1, o1, r1, last), errors, (absorbed, work, loss, impulse)
