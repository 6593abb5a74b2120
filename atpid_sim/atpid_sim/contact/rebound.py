# SPDX-License-Identifier: Apache-2.0
"""Restitution of a Hertz contact with damping c x' x^a, by one integration along the angle of the path.

With times in T = (m/k)^0.4 v^-0.2 and lengths in v T the impact is X'' + g X' X^a + X^1.5 = 0, X(0) = 0, X'(0) = 1. In
z = sqrt(0.8) X^1.25 and polar coordinates X' = R cos(theta), z = R sin(theta) it becomes one smooth equation,

    d ln R / d theta = -D cos^2 / (1 + D sin cos),   D = g X^(a - 1/4) / sqrt(1.25),

that ends where the force vanishes: sin(theta) + D cos(theta) = 0. For a = 1/4, D is constant: Tsuji's closed form.

An integration takes a good part of a millisecond: it is the reference from which `rebound_fit` makes the series of
`rebound_series`, and that the tests compare it with. No impact of a run calls it.
"""

from __future__ import annotations

import math

from atpid_sim.kernel import kernel

#: Error of a step in ln R (times g where that is below 1), and the step at which the release counts as found.
_ERROR = 1e-14
_SHORTEST = 1e-13


@kernel
def hertz_time(speed, mass, k):  # type: ignore[no-untyped-def]
    """Time scale T of a Hertz impact [s]."""
    return (mass / k) ** 0.4 * speed**-0.2


@kernel
def _angle(s):  # type: ignore[no-untyped-def]
    """Angle and its derivative, s from 0 to 1; as flat as s^5 at both ends, where the powers of X are not smooth."""
    rest = s * (1.0 - s)
    theta = math.pi * s**5 * (126.0 + s * (-420.0 + s * (540.0 + s * (-315.0 + 70.0 * s))))
    return theta, 630.0 * math.pi * rest**4


@kernel
def _damping(log_radius, sine, g, a):  # type: ignore[no-untyped-def]
    x = (math.exp(log_radius) * sine / math.sqrt(0.8)) ** 0.8
    return g * x ** (a - 0.25) / math.sqrt(1.25)


@kernel
def _slope(s, log_radius, g, a):  # type: ignore[no-untyped-def]
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
def _step(s, log_radius, h, g, a):  # type: ignore[no-untyped-def]
    first = _slope(s, log_radius, g, a)
    second = _slope(s + 0.5 * h, log_radius + 0.5 * h * first, g, a)
    third = _slope(s + 0.5 * h, log_radius + 0.5 * h * second, g, a)
    fourth = _slope(s + h, log_radius + h * third, g, a)
    return log_radius + h * (first + 2.0 * (second + third) + fourth) / 6.0


@kernel
def log_rebound(g, a):  # type: ignore[no-untyped-def]
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
