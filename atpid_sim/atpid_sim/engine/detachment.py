# SPDX-License-Identifier: Apache-2.0
"""Where inside a step the contact force vanishes or a hysteretic contact turns, by regula falsi (Illinois)."""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.trial_step import trial_step
from atpid_sim.kernel import kernel


@kernel
def detachment(method, segment, model, p, moment, h, motion, end_force):  # type: ignore[no-untyped-def]
    """Size of the step at whose end the contact force vanishes, given that it changes sign within h."""
    begin_force = motion.rates.force
    left, right = 0.0, h
    f_left, f_right = begin_force, end_force
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = trial_step(method, segment, model, p, moment, size, motion)[0].rates.force
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-6 * h or abs(value) <= 1e-6 * (abs(begin_force) + abs(end_force)):
            break
    return size


@kernel
def turning_point(method, segment, model, p, moment, h, motion, end_velocity):  # type: ignore[no-untyped-def]
    """Size of the step at whose end the overlap velocity vanishes: the turning point of a hysteretic contact."""
    left, right = 0.0, h
    f_left, f_right = motion.velocity, end_velocity
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = trial_step(method, segment, model, p, moment, size, motion)[0].velocity
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-9 * h or abs(value) <= 1e-12 * abs(motion.velocity):
            break
    return size


@kernel
def static_overlap(law, p, push, within):  # type: ignore[no-untyped-def]
    """Overlap [m] at which the elastic force alone reaches `push` [N], to the relative accuracy `within`."""
    low, high = 1e-18, 1e3
    for _ in range(100):
        middle = math.sqrt(low * high)
        if force(law, middle, 0.0, middle, p) < push:
            low = middle
        else:
            high = middle
        if high < (1.0 + within) * low:
            break
    return high
