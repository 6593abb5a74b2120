# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One impact of Tsuji's law in closed form: how long it lasts and how wide its force is, for a restitution.

In units of T = (m/k)^0.4 v^-0.2 and m v/T. With z = sqrt(0.8) x^1.25 and ds = sqrt(1.25) x^0.25 dt the path is that
of a linear oscillator of damping ratio zeta (docs/contact.md), and the force times dt is (z + 2 zeta z') ds.
"""

import cmath
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.system import Array

#: Points along the path: the duration is then within 1e-6.
_POINTS = 20_000
#: Acceleration for the derivative of what it changes, in units of v/T.
_PUSH = 0.003


class Pulse(NamedTuple):
    """An impact, in units of T."""

    damping_ratio: float  # zeta of the linear oscillator
    duration: float  # from the first touch until the force vanishes
    width: float  # standard deviation of the time, weighted by the force
    centre: float  # mean of the time, weighted by the force


@cache
def pulse(restitution: float) -> Pulse:
    """Return the impact of a restitution above 0 [-]; 1 and more is Hertz's."""
    zeta = damping_ratio_for(min(restitution, 1.0))
    rate = cmath.sqrt(1.0 - zeta**2) if zeta != 1.0 else 1e-6
    end = abs(2.0 * cmath.acos(zeta) / rate) if zeta != 1.0 else 2.0
    # the points are closer at both ends, where the time is singular
    u = (np.arange(_POINTS) + 0.5) / _POINTS
    s = end * np.sin(0.5 * math.pi * u) ** 2
    step = end * 0.5 * math.pi * np.sin(math.pi * u) / _POINTS
    decay = np.exp(-zeta * s)
    z = (decay * np.sin(rate * s) / rate).real
    slope = (decay * np.cos(rate * s)).real - zeta * z
    passed = step / (math.sqrt(1.25) * (z / math.sqrt(0.8)) ** 0.2)
    time, impulse = np.cumsum(passed) - 0.5 * passed, (z + 2.0 * zeta * slope) * step
    centre = float(time @ impulse / impulse.sum())
    width = math.sqrt(float((time - centre) ** 2 @ impulse / impulse.sum()))
    return Pulse(zeta, float(passed.sum()), width, centre)


@cache
def pressed(restitution: float) -> tuple[float, float]:
    """Return what a relative acceleration a that presses grain and wall together changes, by a (centre) / v to first
    order: the restitution, and the share by which the overlap at the force's centroid is deeper.

    Both with the velocities before and after extrapolated to the centroid, as free motion shows them there.
    """
    damping = math.sqrt(5.0) * damping_ratio_for(restitution)

    def force(overlap: float, velocity: float) -> float:
        return math.copysign(abs(overlap) ** 1.5, overlap) + damping * velocity * math.sqrt(math.sqrt(abs(overlap)))

    def vanishes(_time: float, y: Array) -> float:
        return force(y[0], y[1]) if y[1] < 0.0 else 1.0

    vanishes.terminal = True  # type: ignore[attr-defined]

    def measured(push: float) -> Array:
        def slope(time: float, y: Array) -> list[float]:
            now = max(force(y[0], y[1]), 0.0)
            return [y[1], push - now, now, now * time]

        impulse, moment = solve_ivp(slope, (0.0, 99.0), [1e-12, 1.0, 0.0, 0.0], events=vanishes, rtol=1e-8,
                                    atol=1e-12).y[2:, -1]  # fmt: skip
        centre = moment / impulse
        before = 1.0 + push * centre
        return np.array([impulse / before - 1.0, math.log(centre + 0.5 * push * centre**2) - 0.8 * math.log(before)])

    change = (measured(_PUSH) - measured(-_PUSH)) / (2.0 * _PUSH * pulse(restitution).centre)
    return float(change[0]), float(change[1])


def stiffness(mass: float, speed: float, time: float, scaled: float) -> float:
    """Return k [N/m^1.5] of a contact that takes `time` [s] at a speed [m/s], `scaled` of it in units of T."""
    return float(mass * (scaled / time) ** 2.5 / math.sqrt(speed))
