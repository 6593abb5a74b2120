# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where inside a step the contact force vanishes or a hysteretic contact turns, by regula falsi (Illinois)."""

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.stepping import trial_step
from atpid_sim.kernel import kernel


@kernel
def vanishing(method, segment, model, p, moment, h, motion, end, turning):
    """Size of the step at whose end the contact force vanishes or, `turning`, the overlap velocity.

    Given that it changes sign within h, from `motion` to `end`.
    """
    left, right = 0.0, h
    f_left, f_right = motion.rates.force, end.rates.force
    narrow, small = 1e-6 * h, 1e-6 * (abs(f_left) + abs(f_right))
    if turning:
        f_left, f_right = motion.velocity, end.velocity
        narrow, small = 1e-9 * h, 1e-12 * abs(f_left)
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        reached = trial_step(method, segment, model, p, moment, size, motion)[0]
        value = reached.velocity if turning else reached.rates.force
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= narrow or abs(value) <= small:
            break
    return size


@kernel
def static_overlap(law, p, push, within):
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
