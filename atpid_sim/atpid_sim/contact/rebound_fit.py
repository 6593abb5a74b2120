# SPDX-License-Identifier: Apache-2.0
"""The coefficients of `rebound_series`, made again from the integral of `rebound`.

`python -m atpid_sim.contact.rebound_fit` prints them as they stand there; a test compares them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts1
from numpy.typing import NDArray
from scipy.special import digamma

from atpid_sim.contact.rebound import log_rebound

#: Name in `rebound_series`, power a of the overlap in the damping, number of coefficients.
SERIES = (("LEE_HERRMANN", 0.0, 44), ("KUWABARA_KONO", 0.5, 32))
#: Below this g^-p the strong damping's own expansion holds to 4e-10; the integral loses digits soon after.
STRONG = 1e-6


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


def coefficients(a: float, count: int) -> NDArray[np.float64]:
    """Return the `count` coefficients (count,) [-] of the series that meets r in as many Chebyshev points."""
    points = chebpts1(count)
    damping = [float((1.0 + s) / (1.0 - s)) ** (3.0 - 2.0 * a) for s in points]
    r = [math.expm1(-reference(g, a) * (1.0 + a) / 2.5) / g for g in damping]
    return np.asarray(chebfit(points, r, count - 1))


def main() -> int:
    """Print the lines of `rebound_series`."""
    for name, a, count in SERIES:
        numbers = [f"{c:.12f}," for c in coefficients(a, count)]
        rows = [f"    {' '.join(numbers[i : i + 6])}" for i in range(0, count, 6)]
        print(f"{name} = np.array([", *rows, "])  # fmt: skip", sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
