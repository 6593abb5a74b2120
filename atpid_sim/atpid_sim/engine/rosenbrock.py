# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One implicit step of static contact: the L-stable Rosenbrock method RODAS4.

Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.7.

A grain in static contact follows the beam over fractions of a second while the contact's own time is micro- to
milliseconds: stability, not accuracy, limits an explicit step. The equations, and so the motion, are the same as in
`dormand_prince.py`; nothing is taken as rigid.
"""

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.columns import A0, A1, C0, C1, C2, C3, OMEGA, PHASE
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows, rates_at
from atpid_sim.engine.hermite import hermite, hermite_velocity
from atpid_sim.kernel import inlined, kernel

#: Relative distance over which the force is differenced; its error, 1e-8, is far below that of a step.
_APART = 1e-4

GAMMA = 0.25
A21 = 1.544
A31, A32 = 0.9466785280815826, 0.2557011698983284
A41, A42, A43 = 3.314825187068521, 2.896124015972201, 0.9986419139977817
A51, A52, A53, A54 = 1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950
C21 = -5.6688
C31, C32 = -2.430093356833875, -0.2063599157091915
C41, C42, C43 = -0.1073529058151375, -9.594562251023355, -20.47028614809616
C51, C52, C53, C54 = 7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160
C61, C62, C63 = 8.083246795921522, -7.981132988064893, -31.52159432874371
C64, C65 = 16.31930543123136, -6.058818238834054
T2, T3, T4 = 0.386, 0.21, 0.63
D1, D2, D3, D4 = 0.25, -0.1043, 0.1035, -0.0362
#: The inner node of Lobatto's four-point rule.
INNER = 0.5 - 0.5 / math.sqrt(5.0)


@inlined
def support_with_acceleration(segment, at):
    """Support displacement, velocity and acceleration at local time `at` [s]."""
    angle = segment[OMEGA] * at + segment[PHASE]
    s, c = math.sin(angle), math.cos(angle)
    amplitude, omega = segment[A0] + segment[A1] * at, segment[OMEGA]
    return (
        segment[C0] + at * (segment[C1] + at * (segment[C2] + at * segment[C3])) + amplitude * s,
        segment[C1] + at * (2.0 * segment[C2] + at * 3.0 * segment[C3]) + segment[A1] * s + omega * amplitude * c,
        2.0 * segment[C2] + 6.0 * at * segment[C3] + omega * (2.0 * segment[A1] * c - omega * amplitude * s),
    )


@kernel
def stiffness_and_damping(model, p, overlap, velocity):
    """Derivatives of the contact force by overlap [N/m] and velocity [N s/m]; every law is linear in the velocity."""
    law, memory = model.law, model.memory
    apart = _APART * max(abs(overlap), 1e-15)
    if model.hysteretic:  # one-sided: the force has a kink where unloading begins
        ahead = apart if velocity > 0.0 else -apart
        stiff = (force(law, overlap + ahead, velocity, memory, p) - force(law, overlap, velocity, memory, p)) / ahead
    else:
        above, below = overlap + apart, overlap - apart
        stiff = 0.5 * (force(law, above, velocity, memory, p) - force(law, below, velocity, memory, p)) / apart
    return stiff, force(law, overlap, 1.0, memory, p) - force(law, overlap, 0.0, memory, p)


@kernel
def contact_pace(model, p, overlap, velocity):
    """Fastest rate of the contact's own motion and its undamped angular frequency [1/s]."""
    stiff, damp = stiffness_and_damping(model, p, overlap, velocity)
    natural = math.sqrt(abs(stiff) * model.reduced_inverse)
    return natural + damp * model.reduced_inverse, natural


@inlined
def _accelerations(model, p, u, w, x, v, overlap, velocity):
    pull = model.stiffness * (u - x) - model.damping * (v - w)
    push = force(model.law, overlap, velocity, model.memory, p)
    return (
        (pull - model.side * push) * model.beam_inverse - model.gravity,
        model.side * pull * model.beam_inverse - push * model.reduced_inverse,
    )


@kernel
def implicit_step(segment, model, p, tau, h, motion):
    """One step of size h from local time tau; arguments and result as `dormand_prince.explicit_step`."""
    x, v, overlap, velocity, k, _modes = motion
    side, inverse, reduced = model.side, model.beam_inverse, model.reduced_inverse
    stiff, damp = stiffness_and_damping(model, p, overlap, velocity)
    g = 1.0 / (GAMMA * h)
    # Jacobian of the two accelerations; displacements are eliminated, which leaves two equations for the velocities
    ax, av = -model.stiffness * inverse, -model.damping * inverse
    ao, ar = -side * stiff * inverse, -side * damp * inverse
    bx, bv, bo, br = side * ax, side * av, -stiff * reduced, -damp * reduced
    m11, m12 = g - av - ax / g, -(ar + ao / g)
    m21, m22 = -(bv + bx / g), g - br - bo / g
    scale = 1.0 / (m11 * m22 - m12 * m21)
    _u0, w0, a0 = support_with_acceleration(segment, tau)
    pull_rate = model.stiffness * w0 + model.damping * a0
    fa, fb = h * pull_rate * inverse, h * side * pull_rate * inverse
    ih = 1.0 / h

    # stage 1
    s, t = k.beam_acceleration + D1 * fa, k.overlap_acceleration + D1 * fb
    ev = s + (ax * v + ao * velocity) / g
    er = t + (bx * v + bo * velocity) / g
    v1, r1 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    x1, o1 = (v + v1) / g, (velocity + r1) / g

    # stage 2
    u2, w2, _a = support_with_acceleration(segment, tau + T2 * h)
    vs, rs = v + A21 * v1, velocity + A21 * r1
    s, t = _accelerations(model, p, u2, w2, x + A21 * x1, vs, overlap + A21 * o1, rs)
    px, po = vs + C21 * ih * x1, rs + C21 * ih * o1
    ev = s + C21 * ih * v1 + D2 * fa + (ax * px + ao * po) / g
    er = t + C21 * ih * r1 + D2 * fb + (bx * px + bo * po) / g
    v2, r2 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    x2, o2 = (px + v2) / g, (po + r2) / g

    # stage 3
    u3, w3, _a = support_with_acceleration(segment, tau + T3 * h)
    xs, os = x + A31 * x1 + A32 * x2, overlap + A31 * o1 + A32 * o2
    vs, rs = v + A31 * v1 + A32 * v2, velocity + A31 * r1 + A32 * r2
    s, t = _accelerations(model, p, u3, w3, xs, vs, os, rs)
    px, po = vs + ih * (C31 * x1 + C32 * x2), rs + ih * (C31 * o1 + C32 * o2)
    ev = s + ih * (C31 * v1 + C32 * v2) + D3 * fa + (ax * px + ao * po) / g
    er = t + ih * (C31 * r1 + C32 * r2) + D3 * fb + (bx * px + bo * po) / g
    v3, r3 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    x3, o3 = (px + v3) / g, (po + r3) / g

    # stage 4
    u4, w4, _a = support_with_acceleration(segment, tau + T4 * h)
    xs, os = x + A41 * x1 + A42 * x2 + A43 * x3, overlap + A41 * o1 + A42 * o2 + A43 * o3
    vs, rs = v + A41 * v1 + A42 * v2 + A43 * v3, velocity + A41 * r1 + A42 * r2 + A43 * r3
    s, t = _accelerations(model, p, u4, w4, xs, vs, os, rs)
    px = vs + ih * (C41 * x1 + C42 * x2 + C43 * x3)
    po = rs + ih * (C41 * o1 + C42 * o2 + C43 * o3)
    ev = s + ih * (C41 * v1 + C42 * v2 + C43 * v3) + D4 * fa + (ax * px + ao * po) / g
    er = t + ih * (C41 * r1 + C42 * r2 + C43 * r3) + D4 * fb + (bx * px + bo * po) / g
    v4, r4 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    x4, o4 = (px + v4) / g, (po + r4) / g

    # stage 5
    u5, w5, _a = support_with_acceleration(segment, tau + h)
    xs = x + A51 * x1 + A52 * x2 + A53 * x3 + A54 * x4
    vs = v + A51 * v1 + A52 * v2 + A53 * v3 + A54 * v4
    os = overlap + A51 * o1 + A52 * o2 + A53 * o3 + A54 * o4
    rs = velocity + A51 * r1 + A52 * r2 + A53 * r3 + A54 * r4
    s, t = _accelerations(model, p, u5, w5, xs, vs, os, rs)
    px = vs + ih * (C51 * x1 + C52 * x2 + C53 * x3 + C54 * x4)
    po = rs + ih * (C51 * o1 + C52 * o2 + C53 * o3 + C54 * o4)
    ev = s + ih * (C51 * v1 + C52 * v2 + C53 * v3 + C54 * v4) + (ax * px + ao * po) / g
    er = t + ih * (C51 * r1 + C52 * r2 + C53 * r3 + C54 * r4) + (bx * px + bo * po) / g
    v5, r5 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    x5, o5 = (px + v5) / g, (po + r5) / g

    # stage 6: its increment is the error of the third-order solution
    xs, vs, os, rs = xs + x5, vs + v5, os + o5, rs + r5
    s, t = _accelerations(model, p, u5, w5, xs, vs, os, rs)
    px = vs + ih * (C61 * x1 + C62 * x2 + C63 * x3 + C64 * x4 + C65 * x5)
    po = rs + ih * (C61 * o1 + C62 * o2 + C63 * o3 + C64 * o4 + C65 * o5)
    ev = s + ih * (C61 * v1 + C62 * v2 + C63 * v3 + C64 * v4 + C65 * v5) + (ax * px + ao * po) / g
    er = t + ih * (C61 * r1 + C62 * r2 + C63 * r3 + C64 * r4 + C65 * r5) + (bx * px + bo * po) / g
    v6, r6 = (m22 * ev - m12 * er) * scale, (m11 * er - m21 * ev) * scale
    errors = Errors((px + v6) / g, v6, (po + r6) / g, r6)
    xs, vs, os, rs = xs + errors.x, vs + v6, os + errors.overlap, rs + r6
    last = rates_at(model, p, u5, w5, xs, vs, os, rs)
    end = ContactState(xs, vs, os, rs, last, None)
    return end, errors, _flows(segment, model, p, tau, h, motion, end)


@kernel
def _flows(segment, model, p, tau, h, begin, end):
    """`Flows` of a step, by Lobatto's rule.

    The overlap between the ends is a cubic: its accelerations are the small difference of large forces.
    """
    x, v, overlap, velocity, k, _modes = begin
    x1, v1, overlap1, velocity1, last, _modes = end
    absorbed, work = k.contact_power + last.contact_power, k.support_power + last.support_power
    loss = k.damper_power + last.damper_power
    for node in (INNER, 1.0 - INNER):
        u, w, _a = support_with_acceleration(segment, tau + node * h)
        xm = hermite(node, h, x, v, k.beam_acceleration, x1, v1, last.beam_acceleration)
        vm = hermite_velocity(node, h, x, v, k.beam_acceleration, x1, v1, last.beam_acceleration)
        d = overlap1 - overlap - h * velocity
        e = h * (velocity1 - velocity) - 2.0 * d
        q = d - e  # cubic: overlap + h velocity s + q s^2 + e s^3
        om = overlap + node * (h * velocity + node * (q + node * e))
        rm = (h * velocity + node * (2.0 * q + 3.0 * node * e)) / h
        inner = rates_at(model, p, u, w, xm, vm, om, rm)
        absorbed, work = absorbed + 5.0 * inner.contact_power, work + 5.0 * inner.support_power
        loss = loss + 5.0 * inner.damper_power
    twelfth = h / 12.0
    # the impulse of the force equals the change of the grain's momentum: exact, however stiff the contact
    grain_mass = 1.0 / (model.reduced_inverse - model.beam_inverse)
    gained = (v1 - model.side * velocity1) - (v - model.side * velocity)
    impulse = model.side * grain_mass * (gained + model.gravity * h)
    return Flows(absorbed * twelfth, work * twelfth, loss * twelfth, impulse)
