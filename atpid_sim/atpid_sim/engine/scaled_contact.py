# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One contact under a given relative acceleration: what the tables of contacts are made of.

Overlap xi and its velocity obey, from touch (xi = 0, xi' = speed) until the force vanishes,

    xi'' = b + b1 t + b2 t^2 / 2 + chi J + eta K - F(xi, xi') / m,     J' = F / m,     K' = J

b is the relative acceleration that wall and grain would have without the contact, b1 and b2 its derivatives; chi and
eta are what spring and damper of the beam answer to the beam's recoil. Beam and grain need no more of the contact than
its end and the integrals of its force.
"""

import numpy as np

from atpid_sim.contact.dispatch import force
from atpid_sim.contact.laws import HYSTERETIC
from atpid_sim.kernel import kernel

#: Places of a contact's results.
(
    DURATION,  # from touch until the force vanishes [s]
    OVERLAP,  # then [m]
    VELOCITY,  # of the overlap then [m/s]; negative: surfaces part
    THIRD,  # third integral of the force over the reduced mass [m s]
    MEAN,  # integral of the overlap [m s]
    DEEPEST,  # overlap [m]
    RESULTS,
) = range(7)
#: Places of what drives a contact.
ACCELERATION, RATE, CURVATURE, RECOIL_DAMPER, RECOIL_SPRING, DRIVES = range(6)

_STATES = 6  # overlap, its velocity, J, K, integral of K, integral of the overlap
#: Steps of one contact at most.
_STEPS = 2000
_NODES = np.array([0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0])
_STAGES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ]
)
_ERRORS = np.array([71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025])


@kernel
def _push(law, p, mass, memory, state):
    """Contact force over the reduced mass [m/s^2]."""
    return force(law, state[0], state[1], memory, p) / mass


@kernel
def _slopes(law, p, mass, drive, memory, s, state, out):
    """Derivatives of the state by s, where the time is s^4."""
    t = s * s * s * s
    pace = 4.0 * s * s * s
    push = _push(law, p, mass, memory, state)
    free = drive[ACCELERATION] + t * (drive[RATE] + 0.5 * t * drive[CURVATURE])
    free += drive[RECOIL_DAMPER] * state[2] + drive[RECOIL_SPRING] * state[3]
    out[0] = pace * state[1]
    out[1] = pace * (free - push)
    out[2] = pace * push
    out[3] = pace * state[2]
    out[4] = pace * state[3]
    out[5] = pace * state[0]


@kernel
def _step(law, p, mass, drive, memory, s, h, state, k, end):
    """One step by Dormand and Prince from `state` into `end`; returns the error of overlap and velocity."""
    _slopes(law, p, mass, drive, memory, s, state, k[0])
    for stage in range(1, 7):
        for i in range(_STATES):
            total = 0.0
            for j in range(stage):
                total += _STAGES[stage, j] * k[j, i]
            end[i] = state[i] + h * total
        _slopes(law, p, mass, drive, memory, s + _NODES[stage] * h, end, k[stage])
    overlap = velocity = 0.0
    for j in range(7):
        overlap += _ERRORS[j] * k[j, 0]
        velocity += _ERRORS[j] * k[j, 1]
    return abs(h * overlap), abs(h * velocity)


@kernel
def solve_contact(law, p, mass, speed, drive, scale, longest, rtol, out):
    """Integrate one contact; results into out (RESULTS,). Returns whether the force vanished within `longest` [s].

    speed: at touch [m/s]; drive (DRIVES,): what it is under; scale: a time the contact's is of the order of [s].
    """
    state, end, k = np.zeros(_STATES), np.zeros(_STATES), np.zeros((7, _STATES))
    state[1] = speed
    memory = deepest = 0.0
    s, h = 0.0, 0.1 * scale**0.25
    length = speed * scale
    last = longest**0.25
    turned = not HYSTERETIC[law]
    for _ in range(_STEPS):
        overlap, velocity = _step(law, p, mass, drive, memory, s, h, state, k, end)
        error = max(overlap / length, velocity / speed) / rtol
        if not error <= 1.0:
            h *= max(0.2, 0.9 * error**-0.2) if error == error else 0.1
            continue
        turning = not turned and end[1] < 0.0
        vanished = _push(law, p, mass, memory, end) <= 0.0
        if turning or vanished:
            low, high = 0.0, h
            for _ in range(60):
                middle = 0.5 * (low + high)
                _step(law, p, mass, drive, memory, s, middle, state, k, end)
                if (end[1] if turning else _push(law, p, mass, memory, end)) > 0.0:
                    low = middle
                else:
                    high = middle
                if high - low <= 1e-15 * (s + high):
                    break
            h = high
            _step(law, p, mass, drive, memory, s, h, state, k, end)
        s += h
        state[:] = end
        deepest = max(deepest, state[0])
        if HYSTERETIC[law]:
            memory = deepest
        if turning:
            turned = True
        elif vanished:
            out[DURATION] = s * s * s * s
            out[OVERLAP], out[VELOCITY], out[THIRD], out[MEAN] = state[0], state[1], state[4], state[5]
            out[DEEPEST] = deepest
            return True
        if s > last:
            break
        h = h * min(5.0, max(0.2, 0.9 * max(error, 1e-6) ** -0.2))
    return False
