# SPDX-License-Identifier: Apache-2.0
"""Decrements of a free decay, as the thesis measures them (section 2.3.1): ratios of successive upper peaks."""

import math

import numpy as np

from atpid_sim.system import Array

#: Peaks below this share of the first are noise and rest, not decay.
_SMALLEST = 0.02


def peaks(displacement: Array) -> Array:
    """Return the upper peaks (k,) [m] of a displacement (n,) from rest [m]: the highest point of each upward swing.

    One per swing above zero, so that an impact's ripple makes no second peak.
    """
    above = displacement > 0.0
    edges = np.flatnonzero(np.diff(above.astype(np.int8))) + 1
    swings = np.split(displacement, edges)
    return np.array([swing.max() for swing in swings if len(swing) and swing[0] > 0.0])


def largest_decrement(displacement: Array) -> float:
    """Return the largest ratio of successive upper peaks [-]; NaN where there are fewer than two."""
    found = peaks(displacement)
    if len(found) < 2:
        return math.nan
    found = found[found > _SMALLEST * found[0]]
    return float(np.max(found[:-1] / found[1:])) if len(found) > 1 else math.nan
