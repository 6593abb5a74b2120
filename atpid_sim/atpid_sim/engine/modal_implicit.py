# SPDX-License-Identifier: Apache-2.0
"""One implicit step of static contact on a structure of several modes: `rosenbrock`, mode by mode.

The modes are coupled by the contact alone: with displacements and modes eliminated one equation is left, that of the
overlap's velocity.
"""

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine import rosenbrock as ros
from atpid_sim.engine.dormand_prince import Flows
from atpid_sim.engine.hermite import cubic, cubic_velocity, hermite_velocity
from atpid_sim.engine.modal_step import ERROR, Q_ACCELERATION, STAGE, modal_rates, reached
from atpid_sim.engine.rosenbrock import stiffness_and_damping, support_with_acceleration
from atpid_sim.kernel import kernel

#: Stages, and the row of the work array for what stands on the right.
_STAGES, _RIGHT = 6, 6
_INCREMENTS = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0], [ros.A21, 0.0, 0.0, 0.0, 0.0], [ros.A31, ros.A32, 0.0, 0.0, 0.0],
    [ros.A41, ros.A42, ros.A43, 0.0, 0.0], [ros.A51, ros.A52, ros.A53, ros.A54, 0.0],
    [ros.A51, ros.A52, ros.A53, ros.A54, 1.0],
])  # fmt: skip
_COUPLINGS = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0], [ros.C21, 0.0, 0.0, 0.0, 0.0], [ros.C31, ros.C32, 0.0, 0.0, 0.0],
    [ros.C41, ros.C42, ros.C43, 0.0, 0.0], [ros.C51, ros.C52, ros.C53, ros.C54, 0.0],
    [ros.C61, ros.C62, ros.C63, ros.C64, ros.C65],
])  # fmt: skip
_TIMES = np.array([0.0, ros.T2, ros.T3, ros.T4, 1.0, 1.0])
_CHANGES = np.array([ros.D1, ros.D2, ros.D3, ros.D4, 0.0, 0.0])


@kernel
def _resistance(modes, i, g):
    """What resists a change of a mode's velocity, over its mass, with its displacement eliminated [1/s]."""
    return g + (modes[at.DAMPING, i] + modes[at.STIFFNESS, i] / g) / modes[at.MASS, i]


@kernel
def modal_implicit_step(segment, model, p, tau, h, motion):
    """One step of size h from local time tau; arguments and result as `rosenbrock.implicit_step`."""
    modes, side, rows, (now, end) = model.modes, model.side, model.rows, motion.modes
    count = modes.shape[1]
    last = 2 * count + 1
    stiff, damp = stiffness_and_damping(model, p, motion.overlap, motion.velocity)
    g = 1.0 / (ros.GAMMA * h)
    through, grain_inverse = damp + stiff / g, model.reduced_inverse - model.beam_inverse
    mobility = grain_inverse
    for i in range(count):
        mobility += g / (modes[at.MASS, i] * _resistance(modes, i, g))
    _u, w0, a0 = support_with_acceleration(segment, tau)
    u, w = _u, w0
    for k in range(_STAGES):
        for i in range(count):
            rows[STAGE, i], rows[STAGE, count + i] = now[i, at.Q], now[i, at.Q_RATE]
        rows[STAGE, last - 1], rows[STAGE, last] = motion.overlap, motion.velocity
        for c in range(last + 1):
            rows[_RIGHT, c] = 0.0
        for j in range(k):
            increment, coupling = _INCREMENTS[k, j], _COUPLINGS[k, j] / h
            for c in range(last + 1):
                rows[STAGE, c] += increment * rows[j, c]
                rows[_RIGHT, c] += coupling * rows[j, c]
        u, w, _a = support_with_acceleration(segment, tau + _TIMES[k] * h)
        push = force(model.law, rows[STAGE, last - 1], rows[STAGE, last], model.memory, p)
        change, relative = h * _CHANGES[k], rows[_RIGHT, last] + side * model.gravity - grain_inverse * push
        for i in range(count):
            mass, stiffness = modes[at.MASS, i], modes[at.STIFFNESS, i]
            pull = modes[at.DIRECT, i] * (u + change * w0) + modes[at.RATE, i] * (w + change * a0) - side * push
            pull -= stiffness * rows[STAGE, i] + modes[at.DAMPING, i] * rows[STAGE, count + i]
            relative -= side * rows[_RIGHT, count + i]
            rows[_RIGHT, i] += rows[STAGE, count + i]
            rows[_RIGHT, count + i] += (pull - stiffness * rows[_RIGHT, i] / g) / mass - modes[at.WEIGHT, i]
            relative += side * g * rows[_RIGHT, count + i] / _resistance(modes, i, g)
        rows[_RIGHT, last - 1] += rows[STAGE, last]
        rest = stiff * rows[_RIGHT, last - 1] / g
        rows[k, last] = (relative - mobility * rest) / (g + mobility * through)
        rows[k, last - 1] = (rows[_RIGHT, last - 1] + rows[k, last]) / g
        added = side * (through * rows[k, last] + rest)
        for i in range(count):
            rows[k, count + i] = (rows[_RIGHT, count + i] - added / modes[at.MASS, i]) / _resistance(modes, i, g)
            rows[k, i] = (rows[_RIGHT, i] + rows[k, count + i]) / g
    for c in range(last + 1):
        rows[ERROR, c] = rows[_STAGES - 1, c]
        rows[STAGE, c] += rows[ERROR, c]
    for i in range(count):
        end[i, at.Q], end[i, at.Q_RATE] = rows[STAGE, i], rows[STAGE, count + i]
    rates = modal_rates(model, p, u, w, end, rows[STAGE, last - 1], rows[STAGE, last])
    to, errors = reached(model, motion, rates)
    return to, errors, _flows(segment, model, p, tau, h, motion, to)


@kernel
def _flows(segment, model, p, tau, h, begin, end):
    """`Flows` of a step and those of each mode, by Lobatto's rule, as `rosenbrock.implicit_step` has them.

    The force inside is that which the grain's acceleration needs.
    """
    modes, side, (then, now) = model.modes, model.side, begin.modes
    twelfth = h / 12.0
    grain_mass = 1.0 / (model.reduced_inverse - model.beam_inverse)
    v0, v1 = begin.v - side * begin.velocity, end.v - side * end.velocity
    a0 = begin.rates.beam_acceleration - side * begin.rates.overlap_acceleration
    a1 = end.rates.beam_acceleration - side * end.rates.overlap_acceleration
    for i in range(modes.shape[1]):
        for column in (at.Q_INPUT, at.Q_LOSS, at.Q_CONTACT):
            now[i, column] = then[i, column]
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
            rate = hermite_velocity(
                node, h, then[i, at.Q], then[i, at.Q_RATE], then[i, Q_ACCELERATION], now[i, at.Q], now[i, at.Q_RATE],
                now[i, Q_ACCELERATION],
            )  # fmt: skip
            work = twelfth * weight * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * rate
            loss = twelfth * weight * modes[at.DAMPING, i] * rate * rate
            now[i, at.Q_INPUT] += work
            now[i, at.Q_LOSS] += loss
            now[i, at.Q_CONTACT] -= twelfth * weight * side * push * rate
            support, damper = support + work, damper + loss
    impulse = side * grain_mass * (v1 - v0 + model.gravity * h)
    return Flows(absorbed * twelfth, support, damper, impulse)
