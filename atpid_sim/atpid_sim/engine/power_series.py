# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion of a structure as a power series of time, exact to rounding within a radian of its fastest vibration.

Grains that rest on the structure add their masses where they are and so couple its modes, through the damping too:
there is no closed form mode by mode as in `arc`. The equations of motion give one coefficient from the two before it.
A polynomial's coefficients also bound its derivatives, so no zero of a gap is passed
(docs/research/no_missed_impact.md).
"""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.safe_step import safe_step
from atpid_sim.kernel import kernel

#: Highest power. Within a radian the n-th term is at most 1/n! of the motion: the first left out is 2e-20 of it.
ORDER = 20
#: Parts in which a zero is approached; a grazing one, which takes more, is approached again from where that led.
_APPROACHES = 200


@kernel
def drive_series(segment, tau, u):
    """Write the series (ORDER + 1,) of a drive's signal from local time tau on."""
    c0, c1, c2, c3 = segment[at.C0], segment[at.C1], segment[at.C2], segment[at.C3]
    u[:] = 0.0
    u[0], u[1] = c0 + tau * (c1 + tau * (c2 + tau * c3)), c1 + tau * (2.0 * c2 + tau * 3.0 * c3)
    u[2], u[3] = c2 + 3.0 * c3 * tau, c3
    if segment[at.A0] == 0.0 and segment[at.A1] == 0.0:
        return
    angle, amplitude = segment[at.OMEGA] * tau + segment[at.PHASE], segment[at.A0] + segment[at.A1] * tau
    here, ahead, before, factor = math.sin(angle), math.cos(angle), 0.0, 1.0
    for n in range(ORDER + 1):
        u[n] += factor * amplitude * here + segment[at.A1] * before
        before = factor * here
        here, ahead, factor = ahead, -here, factor * segment[at.OMEGA] / (n + 1.0)


@kernel
def inverse_mass(modes, dampers, shapes, held, inverse):
    """Write the inverse (modes, modes) of the mass matrix of the structure with the grains `held` (dampers,)."""
    count = shapes.shape[1]
    inverse[:] = 0.0
    for i in range(count):
        inverse[i, i] = 1.0 / modes[at.MASS, i]
    for j in range(shapes.shape[0]):
        if held[j]:  # each adds a matrix of rank one (Sherman and Morrison)
            moved = inverse @ shapes[j]
            share = dampers[j, at.GRAIN_MASS] / (1.0 + dampers[j, at.GRAIN_MASS] * (shapes[j] @ moved))
            for i in range(count):
                for k in range(count):
                    inverse[i, k] -= share * moved[i] * moved[k]


@kernel
def enter_force(modes, u, q, n, force):
    """Write the n-th coefficient of the forces (modes,) of drive, springs and dampers."""
    for i in range(force.shape[0]):
        driven = modes[at.DIRECT, i] * u[n] + modes[at.RATE, i] * (n + 1.0) * u[n + 1]
        force[i] = driven - modes[at.STIFFNESS, i] * q[i, n] - modes[at.DAMPING, i] * (n + 1.0) * q[i, n + 1]


@kernel
def structure_series(modes, inverse, weight, u, q):
    """Write the series q (modes, ORDER + 1), whose first two coefficients are there; weight (modes,): forces [N]."""
    count = q.shape[0]
    force = np.empty(count)
    for n in range(ORDER - 1):
        enter_force(modes, u, q, n, force)
        if n == 0:
            force -= weight
        for i in range(count):
            a = 0.0
            for k in range(count):
                a += inverse[i, k] * force[k]
            q[i, n + 2] = a / ((n + 1.0) * (n + 2.0))


@kernel
def value_and_rates(series, s):
    """Value, first and second derivative of a polynomial (ORDER + 1,) at s."""
    value = rate = half = 0.0
    for n in range(series.shape[0] - 1, -1, -1):
        half = half * s + rate
        rate = rate * s + value
        value = value * s + series[n]
    return value, rate, 2.0 * half


@kernel
def first_zero(series, length, touch):
    """How far a polynomial surely stays positive, at most `length`, and whether it has then come down to `touch`.

    A polynomial that begins with (nearly) nothing but a rising cubic is followed from where that surely prevails.
    """
    if length < 1e-100:
        return 0.0, series[0] <= touch and series[1] < 0.0
    fall, third, power = 0.0, 0.0, 1.0
    for n in range(1, series.shape[0]):
        if n >= 3:
            third += n * (n - 1.0) * (n - 2.0) * abs(series[n]) * power / (length * length)
        power *= length
        fall += max(0.0, -series[n]) * power
    if series[0] - fall >= touch or (fall == 0.0 and series[0] >= 0.0):
        return length, False
    s = 0.0
    if abs(series[0]) <= touch and series[1] == 0.0 and series[2] == 0.0 and series[3] > 0.0:
        rest, power = 0.0, 1.0
        for n in range(4, series.shape[0]):
            rest += abs(series[n]) * power
            power *= length
        s = length if 2.0 * rest * length <= series[3] else 0.5 * series[3] / rest
    for _ in range(_APPROACHES):
        if s >= length:
            return length, False
        value, rate, second = value_and_rates(series, s)
        if s == 0.0:
            value, rate, second = series[0], series[1], 2.0 * series[2]
        step = safe_step(value, rate, second, third, length - s)
        if value <= touch and (rate < 0.0 or step == 0.0):
            return s, True
        s = length if step >= length - s else max(s + step, s * (1.0 + 4e-16) + 1e-300)
    return s, False
