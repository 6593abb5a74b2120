# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A mean with its 95 % interval, where every value scatters and every instant was measured with an error.

Restitution scatters from bounce to bounce (Montaine and others, Phys. Rev. E 84 (2011) 041306), and an instant's error
enters the two intervals beside it with opposite signs. How much of the scatter is of which kind is unknown: for each
share the mean and its error follow by generalised least squares, and the interval is that of all shares together, each
weighted by how likely it makes the values. A single guess of the share would leave out its own uncertainty. That the
instants have no part in the scatter counts beforehand as much as all other shares: so it is with a microphone.
"""

import cmath
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import expit, stdtr, stdtrit

from atpid_common.errors import InputError
from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.root import root
from atpid_sim.system import Array

#: Shares of the variance that are of the instants.
_SHARES = np.concatenate(([0.0], expit(np.arange(-4.0, 8.5, 1.0)), [1.0]))
#: Values below which there is no interval worth its name.
FEWEST = 3
#: Relative scatter below that of rounding.
_ROUNDING = 1e-12


class ContactError(InputError):
    """A recording that does not determine the contact: what was given, what is needed."""


class ContactEstimate(NamedTuple):
    """A value with its 95 % interval, and how many values it is from."""

    value: float
    low: float
    high: float
    number: int

    def through(self, function: "np.ufunc") -> "ContactEstimate":
        """Return the estimate of a monotonic function of the value."""
        low, high = sorted((float(function(self.low)), float(function(self.high))))
        return ContactEstimate(float(function(self.value)), low, high, self.number)


def mean(values: Array, timing: Array | None = None) -> ContactEstimate:
    """Return the mean of values (n,); timing (n, k): what an error of each instant does to each value.

    Raises ContactError: fewer than three values.
    """
    count = len(values)
    if count < FEWEST:
        raise ContactError(f"given {count} restitutions or contact times; needed: at least {FEWEST}")
    own = np.eye(count)
    timed = own if timing is None else timing @ timing.T
    timed = timed * count / np.trace(timed)
    shares = _SHARES if timing is not None else np.zeros(1)
    found = np.array([_given_share(values, (1.0 - share) * own + share * timed) for share in shares])
    middles, errors, likelihoods = found.T
    likelihoods[0] += math.log(max(len(shares) - 1, 1))
    return mixture(middles, errors, likelihoods, count - 1, count)


def mixture(middles: Array, errors: Array, likelihoods: Array, freedom: float, number: int) -> ContactEstimate:
    """Return the estimate of a value that has Student's distribution of a middle and an error (k,) each, which of them
    by the logarithm of its likelihood (k,)."""
    weights = np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    far = 2.0 * float(stdtrit(freedom, 0.9999)) * errors
    ends = float((middles - far).min()), float((middles + far).max())

    def quantile(probability: float) -> float:
        return root(lambda x: float(weights @ stdtr(freedom, (x - middles) / errors)) - probability, *ends, rtol=1e-12)

    return ContactEstimate(float(weights @ middles), quantile(0.025), quantile(0.975), number)


def _given_share(values: Array, covariance: Array) -> tuple[float, float, float]:
    """Return mean, its standard error and the restricted log likelihood for a covariance (n, n) but for its size."""
    precision = np.linalg.inv(covariance)
    weight = float(precision.sum())
    middle = float(precision.sum(axis=0) @ values) / weight
    off, freedom = values - middle, len(values) - 1
    square = max(float(off @ precision @ off) / freedom, _ROUNDING**2)
    determinant = float(np.linalg.slogdet(covariance)[1])
    return middle, math.sqrt(square / weight), -0.5 * (determinant + math.log(weight) + freedom * math.log(square))


#: Points along the path: the duration is then within 1e-6.
_POINTS = 20_000
#: Acceleration for the derivative of what it changes, in units of v/T.
_PUSH = 0.003


class _Pulse(NamedTuple):
    """An impact, in units of T."""

    damping_ratio: float  # zeta of the linear oscillator
    duration: float  # from the first touch until the force vanishes
    width: float  # standard deviation of the time, weighted by the force
    centre: float  # mean of the time, weighted by the force


@cache
def pulse(restitution: float) -> _Pulse:
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
    return _Pulse(zeta, float(passed.sum()), width, centre)


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

        impulse, moment = solve_ivp(
            slope, (0.0, 99.0), [1e-12, 1.0, 0.0, 0.0], events=vanishes, rtol=1e-8, atol=1e-12
        ).y[2:, -1]
        centre = moment / impulse
        before = 1.0 + push * centre
        return np.array([impulse / before - 1.0, math.log(centre + 0.5 * push * centre**2) - 0.8 * math.log(before)])

    change = (measured(_PUSH) - measured(-_PUSH)) / (2.0 * _PUSH * pulse(restitution).centre)
    return float(change[0]), float(change[1])


def stiffness(mass: float, speed: float, time: float, scaled: float) -> float:
    """Return k [N/m^1.5] of a contact that takes `time` [s] at a speed [m/s], `scaled` of it in units of T."""
    return float(mass * (scaled / time) ** 2.5 / math.sqrt(speed))
