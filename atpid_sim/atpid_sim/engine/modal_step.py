# SPDX-License-Identifier: Apache-2.0
"""One explicit step of a contact on a structure of several modes: Dormand and Prince, order 5(4), mode by mode.

The same method as `dormand_prince.explicit_step`, whose one mode is written out; here overlap and modes are arrays.
"""

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows, Rates, support_ahead
from atpid_sim.kernel import kernel

_STAGES = 7
#: Nodes, slopes' weights of each stage, weights of the error.
_NODES = np.array([0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0])
_SLOPES = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
])  # fmt: skip
_ERRORS = np.array([71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025])


@kernel
def modal_rates(model, p, u, w, q, q_rate, overlap, velocity):
    """`Rates` with modes (modes,) at q, the drive's signal at u and its rate w; the powers are sums over the modes."""
    return _rates(model, p, u, w, q, q_rate, overlap, velocity, np.empty(q.shape[0]))


@kernel
def _rates(model, p, u, w, q, q_rate, overlap, velocity, accelerations):
    """The same, with each mode's acceleration written into `accelerations` (modes,)."""
    modes, side = model.modes, model.side
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    container = work = loss = 0.0
    for i in range(q.shape[0]):
        driven, slowed = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w, modes[at.DAMPING, i] * q_rate[i]
        pull = driven - modes[at.STIFFNESS, i] * q[i] - slowed
        accelerations[i] = (pull - side * push) / modes[at.MASS, i] - modes[at.WEIGHT, i]
        container += accelerations[i]
        work += driven * q_rate[i]
        loss += slowed * q_rate[i]
    grain = side * push * (model.reduced_inverse - model.beam_inverse) - model.gravity
    return Rates(container, side * (container - grain), push, work, loss, (push - elastic) * velocity)


@kernel
def modal_step(segment, model, p, smooth, moment, h, motion):
    """One step of size h in the variable s; arguments and result as `dormand_prince.explicit_step`."""
    modes, start = model.modes, motion.modes
    count = modes.shape[1]
    size = 2 * count + 2  # displacements and velocities of the modes, overlap and its velocity
    work = np.empty((_STAGES + 2, size))
    slopes, z, stage = work[:_STAGES], work[_STAGES], work[_STAGES + 1]
    accelerations, end = np.empty(count), start.copy()
    for i in range(count):
        z[i], z[count + i] = start[i, at.Q], start[i, at.Q_RATE]
    z[size - 2], z[size - 1] = motion.overlap, motion.velocity
    contact = support = damper = impulse = 0.0
    past, rates = moment.s * moment.s * moment.s * moment.s, motion.rates
    for k in range(_STAGES):
        here = moment.s + _NODES[k] * h
        cubed = here * here * here
        pace, ahead = (4.0 * h * cubed, cubed * here - past) if smooth else (h, _NODES[k] * h)
        for c in range(size):
            total = z[c]
            for j in range(k):
                total += _SLOPES[k, j] * slopes[j, c]
            stage[c] = total
        u, w = support_ahead(segment, moment.tau, ahead, moment.sine, moment.cosine)
        rates = _rates(
            model, p, u, w, stage[:count], stage[count : 2 * count], stage[size - 2], stage[size - 1], accelerations
        )  # fmt: skip
        weight = _SLOPES[_STAGES - 1, k] * pace if k < _STAGES - 1 else 0.0
        for i in range(count):
            rate = stage[count + i]
            slopes[k, i], slopes[k, count + i] = pace * rate, pace * accelerations[i]
            end[i, at.Q_INPUT] += weight * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * rate
            end[i, at.Q_LOSS] += weight * modes[at.DAMPING, i] * rate * rate
            end[i, at.Q_CONTACT] -= weight * model.side * rates.force * rate
        slopes[k, size - 2], slopes[k, size - 1] = pace * stage[size - 1], pace * rates.overlap_acceleration
        contact += weight * rates.contact_power
        impulse += weight * rates.force
        support += weight * rates.support_power
        damper += weight * rates.damper_power
    for c in range(size):  # the last stage is the end of the step; z is its error
        z[c] = 0.0
        for k in range(_STAGES):
            z[c] += _ERRORS[k] * slopes[k, c]
    x = v = apart = faster = 0.0
    first = modes[at.STIFFNESS, 0] / modes[at.MASS, 0]
    for i in range(count):
        end[i, at.Q], end[i, at.Q_RATE] = stage[i], stage[count + i]
        x, v = x + stage[i], v + stage[count + i]
        apart += z[i] * z[i]
        # a velocity counts by the displacement it leads to
        faster += z[count + i] * z[count + i] * first * modes[at.MASS, i] / modes[at.STIFFNESS, i]
    errors = Errors(np.sqrt(apart), np.sqrt(faster), z[size - 2], z[size - 1])
    reached = ContactState(x, v, stage[size - 2], stage[size - 1], rates, end)
    return reached, errors, Flows(contact, support, damper, impulse)
