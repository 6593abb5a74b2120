# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps of a contact on a structure of several modes: Dormand and Prince where explicit, RODAS4 where implicit.

The same methods as `dormand_prince.explicit_step` and `rosenbrock.implicit_step`, whose one mode is written out; here
what the modes have at the stages is kept in rows of the room (`modal_room`).
"""

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows, Rates, support_ahead
from atpid_sim.engine.modal_room import Q_ACCELERATION, end_row, stage_row
from atpid_sim.kernel import chosen, inlined, kernel


def _no_end(modes, y):
    return None


def _first_end(modes, y):
    states, k = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS), end_row(modes, 0)
    for i in range(modes.shape[1]):
        for column in range(at.MODE_COLUMNS):
            modes[k + column, i] = states[i, column]
    return 0


#: (modes, y) -> which of the two ends of a step has the modes' part of a state (`modal_room`); None: one mode.
end_of = chosen(_no_end, _first_end)


@kernel
def enter_end(modes, end, y):
    """Enter the modes at an end of a step into the state."""
    if modes is not None:
        states, k = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS), end_row(modes, end)
        for i in range(modes.shape[1]):
            for column in range(at.MODE_COLUMNS):
                states[i, column] = modes[k + column, i]


@kernel
def modal_rates(model, p, u, w, end, overlap, velocity):
    """`Rates` with the modes at an end of a step, the drive's signal at u and its rate w; enters accelerations.

    The powers are sums over the modes.
    """
    modes, side, k = model.modes, model.side, end_row(model.modes, end)
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    container = work = loss = 0.0
    for i in range(modes.shape[1]):
        rate = modes[k + at.Q_RATE, i]
        driven, slowed = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w, modes[at.DAMPING, i] * rate
        pull = driven - modes[at.STIFFNESS, i] * modes[k + at.Q, i] - slowed
        acceleration = (pull - side * push) / modes[at.MASS, i] - modes[at.WEIGHT, i]
        modes[k + Q_ACCELERATION, i] = acceleration
        container += acceleration
        work += driven * rate
        loss += slowed * rate
    grain = side * push * (model.reduced_inverse - model.beam_inverse) - model.gravity
    return Rates(container, side * (container - grain), push, work, loss, (push - elastic) * velocity)


@inlined
def _forces(model, p, overlap, velocity):
    """Force, power of its damping, and acceleration that the grain has of it and of its weight."""
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    grain = push * (model.reduced_inverse - model.beam_inverse) - model.side * model.gravity
    return push, (push - elastic) * velocity, grain


@kernel
def modal_explicit_step(segment, model, p, smooth, moment, h, motion):
    """One step of size h in the variable s; arguments and result as `dormand_prince.explicit_step`.

    Velocities and accelerations of the modes at the stages are kept, and multiplied by the stages' paces when summed.
    Written out: as a loop over a table of the stages it takes a quarter longer.
    """
    modes, side = model.modes, model.side
    count, k = modes.shape[1], stage_row(modes)
    now, end = end_row(modes, motion.end), end_row(modes, 1 - motion.end)
    tau, s, sine, cosine = moment
    if smooth:
        s2, s3, s4, s5, s6 = s + 0.2 * h, s + 0.3 * h, s + 0.8 * h, s + 8.0 / 9.0 * h, s + h
        z2, z3, z4, z5, z6 = s2 * s2 * s2, s3 * s3 * s3, s4 * s4 * s4, s5 * s5 * s5, s6 * s6 * s6
        p1, p2, p3 = 4.0 * h * s * s * s, 4.0 * h * z2, 4.0 * h * z3
        p4, p5, p6 = 4.0 * h * z4, 4.0 * h * z5, 4.0 * h * z6
        past = s * s * s * s
        t2, t3, t4, t5, t6 = z2 * s2 - past, z3 * s3 - past, z4 * s4 - past, z5 * s5 - past, z6 * s6 - past
    else:
        p1 = p2 = p3 = p4 = p5 = p6 = h
        t2, t3, t4, t5, t6 = 0.2 * h, 0.3 * h, 0.8 * h, 8.0 / 9.0 * h, h
    u1, w1 = support_ahead(segment, tau, 0.0, sine, cosine)
    u2, w2 = support_ahead(segment, tau, t2, sine, cosine)
    u3, w3 = support_ahead(segment, tau, t3, sine, cosine)
    u4, w4 = support_ahead(segment, tau, t4, sine, cosine)
    u5, w5 = support_ahead(segment, tau, t5, sine, cosine)
    u6, w6 = support_ahead(segment, tau, t6, sine, cosine)
    o1, r1, rates = motion.overlap, motion.velocity, motion.rates
    b1, f1, c1 = rates.overlap_acceleration, rates.force, rates.contact_power
    g1 = 0.2 * p1
    o2 = o1 + (g1 * r1)
    r2 = r1 + (g1 * b1)
    _f2, _c2, grain = _forces(model, p, o2, r2)
    thrust, container = side * _f2, 0.0
    for i in range(count):
        q = modes[now + at.Q, i] + (g1 * modes[now + at.Q_RATE, i])
        v = modes[now + at.Q_RATE, i] + (g1 * modes[now + Q_ACCELERATION, i])
        pull = modes[at.DIRECT, i] * u2 + modes[at.RATE, i] * w2 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[k + 2, i], modes[k + 3, i] = v, a
        container += a
    b2 = side * container - grain
    g1, g2 = 3.0 / 40.0 * p1, 9.0 / 40.0 * p2
    o3 = o1 + (g1 * r1 + g2 * r2)
    r3 = r1 + (g1 * b1 + g2 * b2)
    f3, c3, grain = _forces(model, p, o3, r3)
    thrust, container = side * f3, 0.0
    for i in range(count):
        q = modes[now + at.Q, i] + (g1 * modes[now + at.Q_RATE, i] + g2 * modes[k + 2, i])
        v = modes[now + at.Q_RATE, i] + (g1 * modes[now + Q_ACCELERATION, i] + g2 * modes[k + 3, i])
        pull = modes[at.DIRECT, i] * u3 + modes[at.RATE, i] * w3 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[k + 4, i], modes[k + 5, i] = v, a
        container += a
    b3 = side * container - grain
    g1, g2, g3 = 44.0 / 45.0 * p1, -56.0 / 15.0 * p2, 32.0 / 9.0 * p3
    o4 = o1 + (g1 * r1 + g2 * r2 + g3 * r3)
    r4 = r1 + (g1 * b1 + g2 * b2 + g3 * b3)
    f4, c4, grain = _forces(model, p, o4, r4)
    thrust, container = side * f4, 0.0
    for i in range(count):
        q = modes[now + at.Q, i] + (g1 * modes[now + at.Q_RATE, i] + g2 * modes[k + 2, i] + g3 * modes[k + 4, i])
        moved = g1 * modes[now + Q_ACCELERATION, i] + g2 * modes[k + 3, i] + g3 * modes[k + 5, i]
        v = modes[now + at.Q_RATE, i] + moved
        pull = modes[at.DIRECT, i] * u4 + modes[at.RATE, i] * w4 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[k + 6, i], modes[k + 7, i] = v, a
        container += a
    b4 = side * container - grain
    g1, g2, g3, g4 = 19372.0 / 6561.0 * p1, -25360.0 / 2187.0 * p2, 64448.0 / 6561.0 * p3, -212.0 / 729.0 * p4
    o5 = o1 + (g1 * r1 + g2 * r2 + g3 * r3 + g4 * r4)
    r5 = r1 + (g1 * b1 + g2 * b2 + g3 * b3 + g4 * b4)
    f5, c5, grain = _forces(model, p, o5, r5)
    thrust, container = side * f5, 0.0
    for i in range(count):
        moved = g1 * modes[now + at.Q_RATE, i] + g2 * modes[k + 2, i] + g3 * modes[k + 4, i] + g4 * modes[k + 6, i]
        q = modes[now + at.Q, i] + moved
        moved = g1 * modes[now + Q_ACCELERATION, i] + g2 * modes[k + 3, i] + g3 * modes[k + 5, i] + g4 * modes[k + 7, i]
        v = modes[now + at.Q_RATE, i] + moved
        pull = modes[at.DIRECT, i] * u5 + modes[at.RATE, i] * w5 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[k + 8, i], modes[k + 9, i] = v, a
        container += a
    b5 = side * container - grain
    g1, g2, g3 = 9017.0 / 3168.0 * p1, -355.0 / 33.0 * p2, 46732.0 / 5247.0 * p3
    g4, g5 = 49.0 / 176.0 * p4, -5103.0 / 18656.0 * p5
    o6 = o1 + (g1 * r1 + g2 * r2 + g3 * r3 + g4 * r4 + g5 * r5)
    r6 = r1 + (g1 * b1 + g2 * b2 + g3 * b3 + g4 * b4 + g5 * b5)
    f6, c6, grain = _forces(model, p, o6, r6)
    thrust, container = side * f6, 0.0
    for i in range(count):
        moved = g1 * modes[now + at.Q_RATE, i] + g2 * modes[k + 2, i] + g3 * modes[k + 4, i] + g4 * modes[k + 6, i]
        q = modes[now + at.Q, i] + (moved + g5 * modes[k + 8, i])
        moved = g1 * modes[now + Q_ACCELERATION, i] + g2 * modes[k + 3, i] + g3 * modes[k + 5, i] + g4 * modes[k + 7, i]
        v = modes[now + at.Q_RATE, i] + (moved + g5 * modes[k + 9, i])
        pull = modes[at.DIRECT, i] * u6 + modes[at.RATE, i] * w6 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[k + 10, i], modes[k + 11, i] = v, a
        container += a
    b6 = side * container - grain
    g1, g3, g4 = 35.0 / 384.0 * p1, 500.0 / 1113.0 * p3, 125.0 / 192.0 * p4
    g5, g6 = -2187.0 / 6784.0 * p5, 11.0 / 84.0 * p6
    o7 = o1 + (g1 * r1 + g3 * r3 + g4 * r4 + g5 * r5 + g6 * r6)
    r7 = r1 + (g1 * b1 + g3 * b3 + g4 * b4 + g5 * b5 + g6 * b6)
    f7, c7, grain = _forces(model, p, o7, r7)
    thrust, container = side * f7, 0.0
    for i in range(count):
        moved = g1 * modes[now + at.Q_RATE, i] + g3 * modes[k + 4, i] + g4 * modes[k + 6, i] + g5 * modes[k + 8, i]
        q = modes[now + at.Q, i] + (moved + g6 * modes[k + 10, i])
        moved = g1 * modes[now + Q_ACCELERATION, i] + g3 * modes[k + 5, i] + g4 * modes[k + 7, i] + g5 * modes[k + 9, i]
        v = modes[now + at.Q_RATE, i] + (moved + g6 * modes[k + 11, i])
        pull = modes[at.DIRECT, i] * u6 + modes[at.RATE, i] * w6 - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
        a = (pull - thrust) * modes[k, i] - modes[at.WEIGHT, i]
        modes[end + at.Q, i], modes[end + at.Q_RATE, i], modes[end + Q_ACCELERATION, i] = q, v, a
        container += a
    b7 = side * container - grain
    # weights of the result are g1 and g3 to g6; the error's follow
    e1, e3, e4 = 71.0 / 57600.0 * p1, -71.0 / 16695.0 * p3, 71.0 / 1920.0 * p4
    e5, e6, e7 = -17253.0 / 339200.0 * p5, 22.0 / 525.0 * p6, -0.025 * p6
    x = v = apart = faster = support = damper = 0.0
    for i in range(count):
        v1, v3, v4 = modes[now + at.Q_RATE, i], modes[k + 4, i], modes[k + 6, i]
        v5, v6 = modes[k + 8, i], modes[k + 10, i]
        work = modes[at.DIRECT, i] * (g1 * u1 * v1 + g3 * u3 * v3 + g4 * u4 * v4 + g5 * u5 * v5 + g6 * u6 * v6)
        work += modes[at.RATE, i] * (g1 * w1 * v1 + g3 * w3 * v3 + g4 * w4 * v4 + g5 * w5 * v5 + g6 * w6 * v6)
        loss = g1 * v1 * v1 + g3 * v3 * v3 + g4 * v4 * v4 + g5 * v5 * v5 + g6 * v6 * v6
        loss *= modes[at.DAMPING, i]
        given = side * (g1 * f1 * v1 + g3 * f3 * v3 + g4 * f4 * v4 + g5 * f5 * v5 + g6 * f6 * v6)
        modes[end + at.Q_INPUT, i] = modes[now + at.Q_INPUT, i] + work
        modes[end + at.Q_LOSS, i] = modes[now + at.Q_LOSS, i] + loss
        modes[end + at.Q_CONTACT, i] = modes[now + at.Q_CONTACT, i] - given
        support, damper = support + work, damper + loss
        speed = modes[end + at.Q_RATE, i]
        x, v = x + modes[end + at.Q, i], v + speed
        off = e1 * v1 + e3 * v3 + e4 * v4 + e5 * v5 + e6 * v6 + e7 * speed
        apart += off * off
        off = e1 * modes[now + Q_ACCELERATION, i] + e3 * modes[k + 5, i] + e4 * modes[k + 7, i]
        off += e5 * modes[k + 9, i] + e6 * modes[k + 11, i] + e7 * modes[end + Q_ACCELERATION, i]
        # a velocity counts by the displacement it leads to
        faster += off * off / (modes[k, i] * modes[at.STIFFNESS, i])
    deeper = e1 * r1 + e3 * r3 + e4 * r4 + e5 * r5 + e6 * r6 + e7 * r7
    closing = e1 * b1 + e3 * b3 + e4 * b4 + e5 * b5 + e6 * b6 + e7 * b7
    errors = Errors(math.sqrt(apart), math.sqrt(faster * modes[k, 0] * modes[at.STIFFNESS, 0]), deeper, closing)
    contact = g1 * c1 + g3 * c3 + g4 * c4 + g5 * c5 + g6 * c6
    impulse = g1 * f1 + g3 * f3 + g4 * f4 + g5 * f5 + g6 * f6
    end_rates = Rates(container, b7, f7, 0.0, 0.0, c7)
    return ContactState(x, v, o7, r7, end_rates, 1 - motion.end), errors, Flows(contact, support, damper, impulse)
