# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The root of a function of one variable by Brent's method (Algorithms for Minimization without Derivatives, ch. 4).

It is here because the import of scipy.optimize would take a quarter of the time of a short run; a test holds it to
`scipy.optimize.brentq`, digit by digit.
"""

import math
from collections.abc import Callable

#: Steps at most, and the least relative tolerance, as in scipy.
_MOST, _RTOL = 100, 4.0 * 2.0**-52


def root(
    function: Callable[[float], float], low: float, high: float, xtol: float = 2e-12, rtol: float = _RTOL
) -> float:
    """Return where a function that has different signs at `low` and `high` is zero.

    xtol, rtol: absolute and relative tolerance. Raises ValueError where the signs are equal or no root is found.
    """
    before, here = low, high  # the step before, and the best so far
    value_before, value = function(before), function(here)
    if value_before == 0.0 or value == 0.0:
        return before if value_before == 0.0 else here
    if (value_before < 0.0) == (value < 0.0):
        raise ValueError(f"the function has the same sign at {low:g} and {high:g}")
    other, value_other, last, step = before, value_before, 0.0, 0.0  # `other`: where the sign differs
    for _ in range(_MOST):
        if value_before != 0.0 and value != 0.0 and (value_before < 0.0) != (value < 0.0):
            other, value_other = before, value_before
            last = step = here - before
        if abs(value_other) < abs(value):
            before, here, other = here, other, here
            value_before, value, value_other = value, value_other, value
        least = 0.5 * (xtol + rtol * abs(here))
        half = 0.5 * (other - here)
        if value == 0.0 or abs(half) < least:
            return here
        trial = math.inf
        if abs(last) > least and abs(value) < abs(value_before):
            trial = _interpolated(before, here, other, value_before, value, value_other)
        if 2.0 * abs(trial) < min(abs(last), 3.0 * abs(half) - least):
            last, step = step, trial
        else:
            last = step = half
        before, value_before = here, value
        here += step if abs(step) > least else math.copysign(least, half)
        value = function(here)
    raise ValueError(f"no root between {low:g} and {high:g} in {_MOST} steps")


def _interpolated(
    before: float, here: float, other: float, value_before: float, value: float, value_other: float
) -> float:
    """Return the step by the secant, or by inverse quadratic interpolation; infinity where there is none."""
    if before == other:
        return -value * (here - before) / (value - value_before)
    slope_before = (value_before - value) / (before - here)
    slope_other = (value_other - value) / (other - here)
    divisor = slope_other * slope_before * (value_other - value_before)
    step = -value * (value_other * slope_other - value_before * slope_before)
    return step / divisor if divisor != 0.0 else math.inf
