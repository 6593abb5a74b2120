# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The coefficients of `rebound_series`, made again by one integration along the angle of the path of an impact.

`python -m studies rebound` prints them as they stand there; a test compares them.

With times in T = (m/k)^0.4 v^-0.2 and lengths in v T the impact is X'' + g X' X^a + X^1.5 = 0, X(0) = 0, X'(0) = 1. In
z = sqrt(0.8) X^1.25 and polar coordinates X' = R cos(theta), z = R sin(theta) it becomes one smooth equation,

    d ln R / d theta = -D cos^2 / (1 + D sin cos),   D = g X^(a - 1/4) / sqrt(1.25),

that ends where the force vanishes: sin(theta) + D cos(theta) = 0. For a = 1/4, D is constant: Tsuji's closed form.

An integration takes a good part of a millisecond: no impact of a run calls it.
"""

import argparse
import math

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts1
from scipy.special import digamma

from atpid_sim.kernel import kernel
from atpid_sim.system import Array

#: Arguments of the example in the help.
EXAMPLE = ""
#: Name in `rebound_series`, power a of the overlap in the damping, number of coefficients.
SERIES = (("LEE_HERRMANN", 0.0, 44), ("KUWABARA_KONO", 0.5, 32))
#: Below this g^-p the strong damping's own expansion holds to 4e-10; the integral loses digits soon after.
STRONG = 1e-6
#: Error of a step in ln R (times g where that is below 1), and the step at which the release counts as found.
_ERROR = 1e-14
_SHORTEST = 1e-13


@kernel
def _angle(s):
    """Angle and its derivative, s from 0 to 1; as flat as s^5 at both ends, where the powers of X are not smooth."""
    rest = s * (1.0 - s)
    theta = math.pi * s**5 * (126.0 + s * (-420.0 + s * (540.0 + s * (-315.0 + 70.0 * s))))
    return theta, 630.0 * math.pi * rest**4


@kernel
def _damping(log_radius, sine, g, a):
    x = (math.exp(log_radius) * sine / math.sqrt(0.8)) ** 0.8
    return g * x ** (a - 0.25) / math.sqrt(1.25)


@kernel
def _slope(s, log_radius, g, a):
    """d ln R / ds; NaN where the force would pull: no trial stage beyond the release is taken for a good one."""
    theta, stretch = _angle(s)
    sine, cosine = math.sin(theta), math.cos(theta)
    if stretch <= 0.0 or sine <= 0.0:
        return 0.0
    damping = _damping(log_radius, sine, g, a)
    if sine + damping * cosine <= 0.0:
        return math.nan
    return -damping * cosine * cosine / (1.0 + damping * sine * cosine) * stretch


@kernel
def _step(s, log_radius, h, g, a):
    first = _slope(s, log_radius, g, a)
    second = _slope(s + 0.5 * h, log_radius + 0.5 * h * first, g, a)
    third = _slope(s + 0.5 * h, log_radius + 0.5 * h * second, g, a)
    fourth = _slope(s + h, log_radius + h * third, g, a)
    return log_radius + h * (first + 2.0 * (second + third) + fourth) / 6.0


@kernel
def log_rebound(g, a):
    """Logarithm of the restitution [-] for the dimensionless damping g > 0 and the power a of the overlap in it.

    Each step is done whole and in halves, which gives its error; a step that meets NaN holds the release and is halved
    until it is too short to matter. Within 1e-12 of the closed form (a = 1/4) up to g = 1000.
    """
    s, log_radius, h = 0.0, 0.0, 1.0 / 32.0
    tolerance = _ERROR * min(1.0, g)
    while h > _SHORTEST:
        h = min(h, 1.0 - s)
        whole = _step(s, log_radius, h, g, a)
        halves = _step(s + 0.5 * h, _step(s, log_radius, 0.5 * h, g, a), 0.5 * h, g, a)
        error = abs(halves - whole)
        if not error <= 15.0 * tolerance:
            h *= 0.5
            continue
        s += h
        log_radius = halves + (halves - whole) / 15.0
        h *= 2.0 if error < 0.4 * tolerance else 1.0
    return log_radius - 0.5 * math.log1p(math.tan(_angle(s)[0]) ** 2)


def strong_rebound(g: float, a: float) -> float:
    """Restitution [-] for strong damping, its two leading orders.

    With lengths and times in g^(-1 / (1 + a)) and d = g^-p the impact is x'' + x^a x' + d x^1.5 = 0, so

        x' + x^(1 + a) / (1 + a) = 1 - d J,   J the integral of x^1.5 over time.

    Damping alone (d = 0) stops the grain at x0 = (1 + a)^q, q = 1 / (1 + a); its velocity decays as
    exp(-l t - psi(q) - gamma), l = x0^a. Then it creeps back at the velocity d x^(1.5 - a). The force -x'' vanishes at
    the time t when the deceleration of the one is down to that of the other, d^2 (1.5 - a) x0^(2 - 2 a). By then
    J = x0^1.5 (t - (psi(2.5 q) - psi(q)) / l); the equation above with x' = -d x0^(1.5 - a) gives x, and
    e = d x^(1.5 - a).
    """
    q = 1.0 / (1.0 + a)
    d = g ** (-2.5 * q)
    stop = (1.0 + a) ** q
    decay = stop**a
    time = (math.log(decay / ((1.5 - a) * d**2 * stop ** (2.0 - 2.0 * a))) - digamma(q) - np.euler_gamma) / decay
    integral = stop**1.5 * (time - (digamma(2.5 * q) - digamma(q)) / decay)
    return float(d * (stop * (1.0 - d * (integral - stop ** (1.5 - a))) ** q) ** (1.5 - a))


def reference(g: float, a: float) -> float:
    """Return the logarithm of the restitution [-]: the integral, beyond its reach the strong damping's expansion."""
    if g ** (-2.5 / (1.0 + a)) < STRONG:
        return math.log(strong_rebound(g, a))
    return float(log_rebound(g, a))


def coefficients(a: float, count: int) -> Array:
    """Return the `count` coefficients (count,) [-] of the series that meets r in as many Chebyshev points."""
    points = chebpts1(count)
    damping = [float((1.0 + s) / (1.0 - s)) ** (3.0 - 2.0 * a) for s in points]
    r = [math.expm1(-reference(g, a) * (1.0 + a) / 2.5) / g for g in damping]
    return np.asarray(chebfit(points, r, count - 1))


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Declare nothing: there are no arguments."""


def run(_args: argparse.Namespace) -> int:
    """Print the lines of `rebound_series`; return 0."""
    for name, a, count in SERIES:
        numbers = [f"{c:.12f}," for c in coefficients(a, count)]
        rows = [f"    {' '.join(numbers[i : i + 6])}" for i in range(0, count, 6)]
        print(f"{name} = np.array([", *rows, "])  # fmt: skip", sep="\n")
    return 0
