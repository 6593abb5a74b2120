# SPDX-License-Identifier: Apache-2.0
"""Where inside a step the contact force vanishes, or a hysteretic contact turns round: by regula falsi."""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.trial import trial


@kernel
def detachment(way, segment, touching, p, moment, h, motion, end_force):  # type: ignore[no-untyped-def]
    """Size of the step at whose end the contact force vanishes, given that it changes sign within h (Illinois)."""
    begin_force = motion.slope[2]
    left, right = 0.0, h
    f_left, f_right = begin_force, end_force
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = trial(way, segment, touching, p, moment, size, motion)[0].slope[2]
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
def turning_point(way, segment, touching, p, moment, h, motion, end_rate):  # type: ignore[no-untyped-def]
    """Size of the step at whose end the overlap rate vanishes: the turning point of a hysteretic contact (Illinois)."""
    left, right = 0.0, h
    f_left, f_right = motion.rate, end_rate
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = trial(way, segment, touching, p, moment, size, motion)[0].rate
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-9 * h or abs(value) <= 1e-12 * abs(motion.rate):
            break
    return size


@kernel
def resting_overlap(law, p, push, within):  # type: ignore[no-untyped-def]
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
