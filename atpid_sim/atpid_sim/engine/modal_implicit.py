# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One implicit step of static contact on a structure of several modes: `rosenbrock`, mode by mode.

The modes are coupled by the contact alone: with displacements and modes eliminated one equation is left, that of the
overlap's velocity.
"""

import math

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine import rosenbrock as ros
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows
from atpid_sim.engine.hermite import cubic, cubic_velocity, hermite_velocity
from atpid_sim.engine.modal_room import Q_ACCELERATION, end_row, stage_row
from atpid_sim.engine.modal_step import modal_rates
from atpid_sim.engine.rosenbrock import stiffness_and_damping, support_with_acceleration
from atpid_sim.kernel import kernel

_STAGES = 6
_INCREMENTS, _COUPLINGS = np.zeros((_STAGES, 5)), np.zeros((_STAGES, 5))
_INCREMENTS[1, :1], _COUPLINGS[1, :1] = ros.A21, ros.C21
_INCREMENTS[2, :2], _COUPLINGS[2, :2] = (ros.A31, ros.A32), (ros.C31, ros.C32)
_INCREMENTS[3, :3], _COUPLINGS[3, :3] = (ros.A41, ros.A42, ros.A43), (ros.C41, ros.C42, ros.C43)
_INCREMENTS[4:, :4], _COUPLINGS[4, :4] = (ros.A51, ros.A52, ros.A53, ros.A54), (ros.C51, ros.C52, ros.C53, ros.C54)
_INCREMENTS[5, 4], _COUPLINGS[5] = 1.0, (ros.C61, ros.C62, ros.C63, ros.C64, ros.C65)
_TIMES = np.array([0.0, ros.T2, ros.T3, ros.T4, 1.0, 1.0])
_CHANGES = np.array([ros.D1, ros.D2, ros.D3, ros.D4, 0.0, 0.0])


@kernel
def _resistance(modes, i, g):
    """What resists a change of a mode's velocity, over its mass, with its displacement eliminated [1/s]."""
    return g + (modes[at.DAMPING, i] + modes[at.STIFFNESS, i] / g) / modes[at.MASS, i]


@kernel
def modal_implicit_step(segment, model, p, tau, h, motion):
    """One step of size h from local time tau; arguments and result as `rosenbrock.implicit_step`."""
    modes, side, count = model.modes, model.side, model.modes.shape[1]
    now, end = end_row(modes, motion.end), end_row(modes, 1 - motion.end)
    # of each stage four rows: displacements and velocities; overlap and its velocity in the first column
    first = stage_row(modes) + 2
    right = first + 4 * _STAGES  # two rows: what stands on the right
    stiff, damp = stiffness_and_damping(model, p, motion.overlap, motion.velocity)
    g = 1.0 / (ros.GAMMA * h)
    through, grain_inverse = damp + stiff / g, model.reduced_inverse - model.beam_inverse
    mobility = grain_inverse
    for i in range(count):
        mobility += g / (modes[at.MASS, i] * _resistance(modes, i, g))
    u, w0, a0 = support_with_acceleration(segment, tau)
    w, overlap, velocity = w0, motion.overlap, motion.velocity
    for k in range(_STAGES):
        for i in range(count):
            modes[end + at.Q, i], modes[end + at.Q_RATE, i] = modes[now + at.Q, i], modes[now + at.Q_RATE, i]
            modes[right, i] = modes[right + 1, i] = 0.0
        overlap, velocity = motion.overlap, motion.velocity
        deeper = faster = 0.0
        for j in range(k):
            increment, coupling, row = _INCREMENTS[k, j], _COUPLINGS[k, j] / h, first + 4 * j
            for i in range(count):
                modes[end + at.Q, i] += increment * modes[row, i]
                modes[end + at.Q_RATE, i] += increment * modes[row + 1, i]
                modes[right, i] += coupling * modes[row, i]
                modes[right + 1, i] += coupling * modes[row + 1, i]
            overlap, velocity = overlap + increment * modes[row + 2, 0], velocity + increment * modes[row + 3, 0]
            deeper, faster = deeper + coupling * modes[row + 2, 0], faster + coupling * modes[row + 3, 0]
        u, w, _a = support_with_acceleration(segment, tau + _TIMES[k] * h)
        push = force(model.law, overlap, velocity, model.memory, p)
        change, relative = h * _CHANGES[k], faster + side * model.gravity - grain_inverse * push
        for i in range(count):
            mass, stiffness = modes[at.MASS, i], modes[at.STIFFNESS, i]
            pull = modes[at.DIRECT, i] * (u + change * w0) + modes[at.RATE, i] * (w + change * a0) - side * push
            pull -= stiffness * modes[end + at.Q, i] + modes[at.DAMPING, i] * modes[end + at.Q_RATE, i]
            relative -= side * modes[right + 1, i]
            modes[right, i] += modes[end + at.Q_RATE, i]
            modes[right + 1, i] += (pull - stiffness * modes[right, i] / g) / mass - modes[at.WEIGHT, i]
            relative += side * g * modes[right + 1, i] / _resistance(modes, i, g)
        deeper += velocity
        rest, row = stiff * deeper / g, first + 4 * k
        modes[row + 3, 0] = (relative - mobility * rest) / (g + mobility * through)
        modes[row + 2, 0] = (deeper + modes[row + 3, 0]) / g
        added = side * (through * modes[row + 3, 0] + rest)
        for i in range(count):
            modes[row + 1, i] = (modes[right + 1, i] - added / modes[at.MASS, i]) / _resistance(modes, i, g)
            modes[row, i] = (modes[right, i] + modes[row + 1, i]) / g
    row = first + 4 * (_STAGES - 1)  # the last increment is the error of the third-order solution
    x = v = apart = sped = 0.0
    for i in range(count):
        modes[end + at.Q, i] += modes[row, i]
        modes[end + at.Q_RATE, i] += modes[row + 1, i]
        x, v = x + modes[end + at.Q, i], v + modes[end + at.Q_RATE, i]
        apart += modes[row, i] ** 2
        sped += modes[row + 1, i] ** 2 * modes[at.MASS, i] / modes[at.STIFFNESS, i]
    first_pace = modes[at.STIFFNESS, 0] / modes[at.MASS, 0]
    errors = Errors(math.sqrt(apart), math.sqrt(sped * first_pace), modes[row + 2, 0], modes[row + 3, 0])
    overlap, velocity = overlap + errors.overlap, velocity + errors.velocity
    rates = modal_rates(model, p, u, w, 1 - motion.end, overlap, velocity)
    to = ContactState(x, v, overlap, velocity, rates, 1 - motion.end)
    return to, errors, _flows(segment, model, p, tau, h, motion, to)


@kernel
def _flows(segment, model, p, tau, h, begin, end):
    """`Flows` of a step and those of each mode, by Lobatto's rule, as `rosenbrock.implicit_step` has them.

    The force inside is that which the grain's acceleration needs.
    """
    modes, side = model.modes, model.side
    then, now = end_row(modes, begin.end), end_row(modes, end.end)
    twelfth = h / 12.0
    grain_mass = 1.0 / (model.reduced_inverse - model.beam_inverse)
    v0, v1 = begin.v - side * begin.velocity, end.v - side * end.velocity
    a0 = begin.rates.beam_acceleration - side * begin.rates.overlap_acceleration
    a1 = end.rates.beam_acceleration - side * end.rates.overlap_acceleration
    for i in range(modes.shape[1]):
        for column in (at.Q_INPUT, at.Q_LOSS, at.Q_CONTACT):
            modes[now + column, i] = modes[then + column, i]
    absorbed = support = damper = 0.0
    for node, weight in ((0.0, 1.0), (ros.INNER, 5.0), (1.0 - ros.INNER, 5.0), (1.0, 1.0)):
        u, w, _a = support_with_acceleration(segment, tau + node * h)
        falling = 6.0 * node * (node - 1.0) * (v0 - v1) / h
        a = falling + (3.0 * node - 1.0) * (node - 1.0) * a0 + node * (3.0 * node - 2.0) * a1
        push = side * grain_mass * (a + model.gravity)
        depth = cubic(node, h, begin.overlap, begin.velocity, end.overlap, end.velocity)
        closing = cubic_velocity(node, h, begin.overlap, begin.velocity, end.overlap, end.velocity)
        if not model.hysteretic:
            damping = force(model.law, depth, closing, model.memory, p) - force(model.law, depth, 0.0, model.memory, p)
            absorbed += weight * damping * closing
        else:
            absorbed += weight * force(model.law, depth, closing, model.memory, p) * closing
        for i in range(modes.shape[1]):
            q0, v0_i, a0_i = modes[then + at.Q, i], modes[then + at.Q_RATE, i], modes[then + Q_ACCELERATION, i]
            q1, v1_i, a1_i = modes[now + at.Q, i], modes[now + at.Q_RATE, i], modes[now + Q_ACCELERATION, i]
            rate = hermite_velocity(node, h, q0, v0_i, a0_i, q1, v1_i, a1_i)
            work = twelfth * weight * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * rate
            loss = twelfth * weight * modes[at.DAMPING, i] * rate * rate
            modes[now + at.Q_INPUT, i] += work
            modes[now + at.Q_LOSS, i] += loss
            modes[now + at.Q_CONTACT, i] -= twelfth * weight * side * push * rate
            support, damper = support + work, damper + loss
    impulse = side * grain_mass * (v1 - v0 + model.gravity * h)
    return Flows(absorbed * twelfth, support, damper, impulse)
