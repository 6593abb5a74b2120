# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A mean with its 95 % interval, where every value scatters and every instant was measured with an error.

Restitution scatters from bounce to bounce (Montaine and others, Phys. Rev. E 84 (2011) 041306), and an instant's error
enters the two intervals beside it with opposite signs. How much of the scatter is of which kind is unknown: for each
share the mean and its error follow by generalised least squares, and the interval is that of all shares together, each
weighted by how likely it makes the values. A single guess of the share would leave out its own uncertainty. That the
instants have no part in the scatter counts beforehand as much as all other shares: so it is with a microphone.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import expit, stdtr, stdtrit

from atpid_common.errors import InputError
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
