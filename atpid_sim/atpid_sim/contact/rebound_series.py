# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution of a Hertz contact with damping c x' x^a for a = 0 and a = 1/2, by one Chebyshev series each.

With the dimensionless damping g (docs/contact.md) and p = 2.5 / (1 + a) the restitution is written

    e = (1 + g r)^-p,   r = sum of c_n T_n(s),   s = (u - 1) / (u + 1),   u = g^(1 / (3 - 2 a)),

so that every g from 0 to infinity lies in -1 <= s <= 1, and r goes from one known number to another:

- weak damping, s = -1: r = C / p with 1 - e = C g, C = 0.8 * 1.25^q B(q, 3/2), q = 0.4 (1 + a), the loss along the
  undamped path (Schwager and Poeschel, Phys. Rev. E 78 (2008) 051304, for a = 1/2). Release at the overlap
  x = g^(1 / (1.5 - a)), whose root is u, makes r a power series in u.
- strong damping, s = 1: damping alone stops the grain at x^(1 + a) = (1 + a) / g, the force vanishes at the velocity
  x^(1.5 - a) / g: r = (1 + a)^((a - 1.5) / 2.5).

e is within 1e-8 of the integral, everywhere; how the coefficients were made: docs/decisions/0066.
"""

import numpy as np

from atpid_sim.contact.law_kernel import kernel

#: c_0, c_1, ... for a = 0.
LEE_HERRMANN = np.fromstring(
    """
    0.829405507089 0.173424911620 0.046718463343 -0.039429452169 -0.027470186024 0.009459541566
    0.012497549504 -0.000473090563 -0.004821988010 -0.001086689817 0.001573210662 0.000848802646
    -0.000393670855 -0.000445387102 0.000039017982 0.000191386017 0.000035037169 -0.000069487322
    -0.000032854562 0.000020281244 0.000019052305 -0.000003549690 -0.000008961488 -0.000000819336
    0.000003598255 0.000001277135 -0.000001211713 -0.000000859248 0.000000301714 0.000000448114
    -0.000000016265 -0.000000198610 -0.000000043462 0.000000075542 0.000000038178 -0.000000023379
    -0.000000022692 0.000000004499 0.000000011166 0.000000000919 -0.000000004754 -0.000000001827
    0.000000001646 0.000000001730
    """,
    sep=" ",
)
#: c_0, c_1, ... for a = 1/2.
KUWABARA_KONO = np.fromstring(
    """
    0.762313447512 0.088232376978 0.011483412646 -0.008841160863 -0.002356939442 -0.000178338456
    -0.000310518921 -0.000143003648 0.000048034429 0.000043192818 -0.000001140695 -0.000007425591
    -0.000000311899 0.000001339359 0.000000149376 -0.000000211120 -0.000000005634 0.000000062907
    0.000000017933 -0.000000001670 0.000000003878 0.000000006048 0.000000003539 0.000000001956
    0.000000001649 0.000000001393 0.000000001017 0.000000000726 0.000000000535 0.000000000381
    0.000000000240 0.000000000115
    """,
    sep=" ",
)


@kernel
def hertz_time(speed, mass, k):
    """Time scale T of a Hertz impact [s]."""
    return (mass / k) ** 0.4 * speed**-0.2


@kernel
def _chebyshev(s, c):
    """Sum of c[n] T_n(s), by Clenshaw's recurrence."""
    last, before = 0.0, 0.0
    for i in range(c.size - 1, 0, -1):
        last, before = 2.0 * s * last - before + c[i], last
    return s * last - before + c[0]


@kernel
def series_rebound(g, a, c):
    """Restitution [-] for the dimensionless damping g >= 0, the damping's power a of the overlap and its series c."""
    s = 1.0 - 2.0 / (1.0 + g ** (1.0 / (3.0 - 2.0 * a)))
    return (1.0 + g * _chebyshev(s, c)) ** (-2.5 / (1.0 + a))
