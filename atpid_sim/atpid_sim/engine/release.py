# SPDX-License-Identifier: Apache-2.0
"""Where inside a step the contact force vanishes, or a hysteretic contact turns round: by regula falsi."""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.rest import implicit_step
from atpid_sim.engine.step import explicit_step


@kernel
def _end_of(resting, segment, touching, p, tau, sine, cosine, smooth, s, h, x, v, overlap, rate, k):  # type: ignore[no-untyped-def]
    """Force and overlap rate at the end of a step of size h."""
    if resting:
        end = implicit_step(segment, touching, p, tau, h, x, v, overlap, rate, k)
    else:
        end = explicit_step(segment, touching, p, tau, sine, cosine, smooth, s, h, x, v, overlap, rate, k)
    return end[4][2], end[3]


@kernel
def detachment(  # type: ignore[no-untyped-def]
    resting, segment, touching, p, tau, sine, cosine, smooth, s, h, x, v, overlap, rate, k, end_force
):  # fmt: skip
    """Size of the step at whose end the contact force vanishes, given that it changes sign within h (Illinois)."""
    left, right = 0.0, h
    f_left, f_right = k[2], end_force
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = _end_of(resting, segment, touching, p, tau, sine, cosine, smooth, s, size, x, v, overlap, rate, k)[0]
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-6 * h or abs(value) <= 1e-6 * (abs(k[2]) + abs(end_force)):
            break
    return size


@kernel
def turning_point(  # type: ignore[no-untyped-def]
    resting, segment, touching, p, tau, sine, cosine, smooth, s, h, x, v, overlap, rate, k, end_rate
):  # fmt: skip
    """Size of the step at whose end the overlap rate vanishes: the turning point of a hysteretic contact (Illinois)."""
    left, right = 0.0, h
    f_left, f_right = rate, end_rate
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = _end_of(resting, segment, touching, p, tau, sine, cosine, smooth, s, size, x, v, overlap, rate, k)[1]
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-9 * h or abs(value) <= 1e-12 * abs(rate):
            break
    return size


@kernel
def resting_overlap(law, p, push):  # type: ignore[no-untyped-def]
    """Overlap [m] at which the elastic force alone reaches `push` [N]: the size against which errors are measured."""
    low, high = 1e-18, 1e3
    for _ in range(60):
        middle = math.sqrt(low * high)
        if force(law, middle, 0.0, middle, p) < push:
            low = middle
        else:
            high = middle
        if high < 1.1 * low:
            break
    return high
