# SPDX-License-Identifier: Apache-2.0
"""Steps of a contact on a structure of several modes: Dormand and Prince where explicit, RODAS4 where implicit.

The same methods as `dormand_prince.explicit_step` and `rosenbrock.implicit_step`, whose one mode is written out; here
what the modes have at the stages is kept in rows of the room (`modal_room`).
"""

import math

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows, Rates, support_ahead
from atpid_sim.engine.modal_room import Q_ACCELERATION, end_row, stage_row
from atpid_sim.kernel import chosen, inlined, kernel

#: Nodes, the stages' weights of the slopes before them, weights of the error.
_STAGES = 7
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
# Rows of a stage: velocities and accelerations of the modes; in the first column what the stage has beside these.
_PACE, _WEIGHT, _SPEED, _FASTER, _FORCE, _POWER, _SIGNAL, _SIGNAL_RATE, _STAGE_ROWS = range(2, 11)


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


@kernel
def modal_explicit_step(segment, model, p, smooth, moment, h, motion):
    """One step of size h in the variable s; arguments and result as `dormand_prince.explicit_step`."""
    modes, side, rates = model.modes, model.side, motion.rates
    count, inverse = modes.shape[1], stage_row(modes)
    now, end, first = end_row(modes, motion.end), end_row(modes, 1 - motion.end), inverse + 2
    tau, s, sine, cosine = moment
    past, pace = s * s * s * s, 4.0 * h * s * s * s if smooth else h
    u, w = support_ahead(segment, tau, 0.0, sine, cosine)
    for i in range(count):
        modes[first, i], modes[first + 1, i] = modes[now + at.Q_RATE, i], modes[now + Q_ACCELERATION, i]
    overlap, velocity, faster = motion.overlap, motion.velocity, rates.overlap_acceleration
    _enter(modes, first, pace, velocity, faster, rates.force, rates.contact_power, u, w)
    for stage in range(1, _STAGES):
        row, pace, ahead = first + stage * _STAGE_ROWS, h, _NODES[stage] * h
        if smooth:
            here = s + ahead
            cubed = here * here * here
            pace, ahead = 4.0 * h * cubed, cubed * here - past
        u, w = support_ahead(segment, tau, ahead, sine, cosine)
        for j in range(stage):
            before = first + j * _STAGE_ROWS
            modes[before + _WEIGHT, 0] = _SLOPES[stage, j] * modes[before + _PACE, 0]
        overlap = motion.overlap + _weighted(modes, first, stage, _SPEED, 0)
        velocity = motion.velocity + _weighted(modes, first, stage, _FASTER, 0)
        push = force(model.law, overlap, velocity, model.memory, p)
        elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
        thrust, container = side * push, 0.0
        for i in range(count):
            q = modes[now + at.Q, i] + _weighted(modes, first, stage, 0, i)
            v = modes[now + at.Q_RATE, i] + _weighted(modes, first, stage, 1, i)
            driven = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w
            pull = driven - modes[at.STIFFNESS, i] * q - modes[at.DAMPING, i] * v
            a = (pull - thrust) * modes[inverse, i] - modes[at.WEIGHT, i]
            modes[row, i], modes[row + 1, i] = v, a
            modes[end + at.Q, i], modes[end + at.Q_RATE, i], modes[end + Q_ACCELERATION, i] = q, v, a
            container += a
        grain = push * (model.reduced_inverse - model.beam_inverse) - side * model.gravity
        faster = side * container - grain
        _enter(modes, row, pace, velocity, faster, push, (push - elastic) * velocity, u, w)
    # the weights of the last stage are those of the result, which it is
    contact, impulse = _weighted(modes, first, _STAGES - 1, _POWER, 0), _weighted(modes, first, _STAGES - 1, _FORCE, 0)
    x = v = apart = sped = support = damper = 0.0
    for i in range(count):
        work = pushed = loss = given = 0.0
        for j in range(_STAGES - 1):
            row = first + j * _STAGE_ROWS
            weight, rate = modes[row + _WEIGHT, 0], modes[row, i]
            work += weight * modes[row + _SIGNAL, 0] * rate
            pushed += weight * modes[row + _SIGNAL_RATE, 0] * rate
            loss += weight * rate * rate
            given += weight * modes[row + _FORCE, 0] * rate
        work = modes[at.DIRECT, i] * work + modes[at.RATE, i] * pushed
        loss *= modes[at.DAMPING, i]
        modes[end + at.Q_INPUT, i] = modes[now + at.Q_INPUT, i] + work
        modes[end + at.Q_LOSS, i] = modes[now + at.Q_LOSS, i] + loss
        modes[end + at.Q_CONTACT, i] = modes[now + at.Q_CONTACT, i] - side * given
        support, damper = support + work, damper + loss
        x, v = x + modes[end + at.Q, i], v + modes[end + at.Q_RATE, i]
    for j in range(_STAGES):
        row = first + j * _STAGE_ROWS
        modes[row + _WEIGHT, 0] = _ERRORS[j] * modes[row + _PACE, 0]
    for i in range(count):
        apart += _weighted(modes, first, _STAGES, 0, i) ** 2
        # a velocity counts by the displacement it leads to
        sped += _weighted(modes, first, _STAGES, 1, i) ** 2 / (modes[inverse, i] * modes[at.STIFFNESS, i])
    errors = Errors(
        math.sqrt(apart), math.sqrt(sped * modes[inverse, 0] * modes[at.STIFFNESS, 0]),
        _weighted(modes, first, _STAGES, _SPEED, 0), _weighted(modes, first, _STAGES, _FASTER, 0),
    )  # fmt: skip
    end_rates = Rates(container, faster, push, 0.0, 0.0, (push - elastic) * velocity)
    reached = ContactState(x, v, overlap, velocity, end_rates, 1 - motion.end)
    return reached, errors, Flows(contact, support, damper, impulse)


@inlined
def _enter(modes, row, pace, velocity, faster, push, power, u, w):
    """Enter what a stage has beside its modes."""
    modes[row + _PACE, 0], modes[row + _SPEED, 0], modes[row + _FASTER, 0] = pace, velocity, faster
    modes[row + _FORCE, 0], modes[row + _POWER, 0] = push, power
    modes[row + _SIGNAL, 0], modes[row + _SIGNAL_RATE, 0] = u, w


@inlined
def _weighted(modes, first, stages, column, i):
    """Sum over the first stages of a number of theirs, each by its weight."""
    total = 0.0
    for j in range(stages):
        row = first + j * _STAGE_ROWS
        total += modes[row + _WEIGHT, 0] * modes[row + column, i]
    return total
