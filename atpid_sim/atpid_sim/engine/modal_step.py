# SPDX-License-Identifier: Apache-2.0
"""Steps of a contact on a structure of several modes: Dormand and Prince where explicit, RODAS4 where implicit.

The same methods as `dormand_prince.explicit_step` and `rosenbrock.implicit_step`, whose one mode is written out; here
displacements and velocities of the modes, then overlap and its velocity, are rows of work arrays.
"""

import math

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.engine import columns as at
from atpid_sim.engine.dormand_prince import ContactState, Errors, Flows, Rates, support_ahead
from atpid_sim.kernel import chosen, kernel

#: Rows of the work array: slopes of the stages, then the state at a stage, and the start, which becomes the error.
_STAGES, STAGE, ERROR, _ROWS = 7, 7, 8, 9
#: Nodes, weights of the result and of the error.
_NODES = (0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0)
_WEIGHTS = (35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0, 0.0)
_ERRORS = (71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025)
#: Columns of a mode in a contact: those of the state, and its acceleration.
Q_ACCELERATION, _COLUMNS = at.MODE_COLUMNS, at.MODE_COLUMNS + 1


def _nothing(modes, y):
    return None


def _places(modes, y):
    count = modes.shape[1]
    now, then = np.zeros((count, _COLUMNS)), np.empty((count, _COLUMNS))
    now[:, : at.MODE_COLUMNS] = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    return now, then


def _rows(modes):
    return np.empty((_ROWS, 2 * modes.shape[1] + 2))


def _no_rows(modes):
    return None


#: (modes, y) -> the modes' part of a state (modes, columns), and room for what a step leads to; None: one mode.
places_of = chosen(_nothing, _places)
#: (modes) -> room for the stages of a step.
rows_of = chosen(_no_rows, _rows)


@kernel
def enter_places(places, y):
    """Enter the modes' part of a state."""
    if places is not None:
        y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)[:, :] = places[0][:, : at.MODE_COLUMNS]


@kernel
def modal_rates(model, p, u, w, states, overlap, velocity):
    """`Rates` with modes in `states` (modes, columns), the drive's signal at u and its rate w; enters accelerations.

    The powers are sums over the modes.
    """
    modes, side = model.modes, model.side
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    container = work = loss = 0.0
    for i in range(states.shape[0]):
        rate = states[i, at.Q_RATE]
        driven, slowed = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w, modes[at.DAMPING, i] * rate
        pull = driven - modes[at.STIFFNESS, i] * states[i, at.Q] - slowed
        acceleration = (pull - side * push) / modes[at.MASS, i] - modes[at.WEIGHT, i]
        states[i, Q_ACCELERATION] = acceleration
        container += acceleration
        work += driven * rate
        loss += slowed * rate
    grain = side * push * (model.reduced_inverse - model.beam_inverse) - model.gravity
    return Rates(container, side * (container - grain), push, work, loss, (push - elastic) * velocity)


@kernel
def _slope(model, p, u, w, pace, weight, k, rows, end):
    """Enter the slopes times `pace` of stage k, whose powers count with `weight` for each mode; returns `Rates`."""
    modes, side, count = model.modes, model.side, end.shape[0]
    overlap, velocity = rows[STAGE, 2 * count], rows[STAGE, 2 * count + 1]
    push = force(model.law, overlap, velocity, model.memory, p)
    elastic = 0.0 if model.hysteretic else force(model.law, overlap, 0.0, model.memory, p)
    container = work = loss = 0.0
    for i in range(count):
        rate = rows[STAGE, count + i]
        driven, slowed = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w, modes[at.DAMPING, i] * rate
        pull = driven - modes[at.STIFFNESS, i] * rows[STAGE, i] - slowed - side * push
        acceleration = pull / modes[at.MASS, i] - modes[at.WEIGHT, i]
        rows[k, i], rows[k, count + i] = pace * rate, pace * acceleration
        container += acceleration
        work += driven * rate
        loss += slowed * rate
        end[i, at.Q_INPUT] += weight * driven * rate
        end[i, at.Q_LOSS] += weight * slowed * rate
        end[i, at.Q_CONTACT] -= weight * side * push * rate
        end[i, Q_ACCELERATION] = acceleration
    grain = side * push * (model.reduced_inverse - model.beam_inverse) - model.gravity
    rates = Rates(container, side * (container - grain), push, work, loss, (push - elastic) * velocity)
    rows[k, 2 * count], rows[k, 2 * count + 1] = pace * velocity, pace * rates.overlap_acceleration
    return rates


@kernel
def modal_explicit_step(segment, model, p, smooth, moment, h, motion):
    """One step of size h in the variable s; arguments and result as `dormand_prince.explicit_step`."""
    modes, rows, (now, end) = model.modes, model.rows, motion.modes
    count = modes.shape[1]
    size = 2 * count + 2
    for i in range(count):
        rows[ERROR, i], rows[ERROR, count + i] = now[i, at.Q], now[i, at.Q_RATE]
        end[i, at.Q_INPUT], end[i, at.Q_LOSS] = now[i, at.Q_INPUT], now[i, at.Q_LOSS]
        end[i, at.Q_CONTACT] = now[i, at.Q_CONTACT]
    rows[ERROR, size - 2], rows[ERROR, size - 1] = motion.overlap, motion.velocity
    contact = support = damper = impulse = 0.0
    past, rates = moment.s * moment.s * moment.s * moment.s, motion.rates
    for k in range(_STAGES):
        here = moment.s + _NODES[k] * h
        cubed = here * here * here
        pace, ahead = (4.0 * h * cubed, cubed * here - past) if smooth else (h, _NODES[k] * h)
        if k == 0:  # known from the end of the step before
            w1 = _WEIGHTS[0] * pace
            u, w = support_ahead(segment, moment.tau, 0.0, moment.sine, moment.cosine)
            for i in range(count):
                rate, driven = rows[ERROR, count + i], modes[at.DIRECT, i] * u + modes[at.RATE, i] * w
                rows[0, i], rows[0, count + i] = pace * rate, pace * now[i, Q_ACCELERATION]
                end[i, at.Q_INPUT] += w1 * driven * rate
                end[i, at.Q_LOSS] += w1 * modes[at.DAMPING, i] * rate * rate
                end[i, at.Q_CONTACT] -= w1 * model.side * rates.force * rate
            rows[0, size - 2], rows[0, size - 1] = pace * motion.velocity, pace * rates.overlap_acceleration
        elif k == 1:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + 0.2 * rows[0, c]
        elif k == 2:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + (3.0 / 40.0 * rows[0, c] + 9.0 / 40.0 * rows[1, c])
        elif k == 3:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + (44.0 / 45.0 * rows[0, c] - 56.0 / 15.0 * rows[1, c] + 32.0 / 9.0 * rows[2, c])
        elif k == 4:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + (
                    19372.0 / 6561.0 * rows[0, c] - 25360.0 / 2187.0 * rows[1, c] + 64448.0 / 6561.0 * rows[2, c]
                    - 212.0 / 729.0 * rows[3, c]
                )  # fmt: skip
        elif k == 5:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + (
                    9017.0 / 3168.0 * rows[0, c] - 355.0 / 33.0 * rows[1, c] + 46732.0 / 5247.0 * rows[2, c] + 49.0 / 176.0 * rows[3, c]
                    - 5103.0 / 18656.0 * rows[4, c]
                )  # fmt: skip
        else:
            for c in range(size):
                rows[STAGE, c] = rows[ERROR, c] + (
                    35.0 / 384.0 * rows[0, c] + 500.0 / 1113.0 * rows[2, c] + 125.0 / 192.0 * rows[3, c] - 2187.0 / 6784.0 * rows[4, c]
                    + 11.0 / 84.0 * rows[5, c]
                )  # fmt: skip
        weight = _WEIGHTS[k] * pace
        if k > 0:
            u, w = support_ahead(segment, moment.tau, ahead, moment.sine, moment.cosine)
            rates = _slope(model, p, u, w, pace, weight, k, rows, end)
        contact += weight * rates.contact_power
        impulse += weight * rates.force
        support += weight * rates.support_power
        damper += weight * rates.damper_power
    for c in range(size):  # what was the start becomes the error
        rows[ERROR, c] = (
            _ERRORS[0] * rows[0, c] + _ERRORS[2] * rows[2, c] + _ERRORS[3] * rows[3, c] + _ERRORS[4] * rows[4, c] + _ERRORS[5] * rows[5, c]
            + _ERRORS[6] * rows[6, c]
        )  # fmt: skip
    to, errors = reached(model, motion, rates)
    return to, errors, Flows(contact, support, damper, impulse)


@kernel
def reached(model, motion, rates):
    """`ContactState` at the end of a step and its `Errors`: from the last two rows of the work arrays."""
    modes, rows, (now, end) = model.modes, model.rows, motion.modes
    count = modes.shape[1]
    x = v = apart = faster = 0.0
    first = modes[at.STIFFNESS, 0] / modes[at.MASS, 0]
    for i in range(count):
        end[i, at.Q], end[i, at.Q_RATE] = rows[STAGE, i], rows[STAGE, count + i]
        x, v = x + rows[STAGE, i], v + rows[STAGE, count + i]
        apart += rows[ERROR, i] * rows[ERROR, i]
        # a velocity counts by the displacement it leads to
        faster += rows[ERROR, count + i] * rows[ERROR, count + i] * first * modes[at.MASS, i] / modes[at.STIFFNESS, i]
    errors = Errors(math.sqrt(apart), math.sqrt(faster), rows[ERROR, 2 * count], rows[ERROR, 2 * count + 1])
    return ContactState(x, v, rows[STAGE, 2 * count], rows[STAGE, 2 * count + 1], rates, (end, now)), errors
