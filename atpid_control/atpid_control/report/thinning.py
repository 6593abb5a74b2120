# SPDX-License-Identifier: Apache-2.0
"""Fewer points of a long curve, with every extreme kept: what is drawn of a run of hours."""

import numpy as np
from numpy.typing import NDArray

from atpid_sim.system import Array


def extremes(value: Array, points: int) -> NDArray[np.intp]:
    """Return at most about `points` indices of `value` (n,), rising: the highest and lowest of each bucket, the last.

    All of them where there are no more. NaN counts as zero.
    """
    if len(value) <= points:
        return np.arange(len(value))
    width = -(-len(value) // max(1, points // 2))
    starts = np.arange(0, len(value), width)
    blocks = [value[start : start + width] for start in starts]
    filled = [np.where(np.isfinite(block), block, 0.0) for block in blocks]
    low, high = (starts + [int(place(block)) for block in filled] for place in (np.argmin, np.argmax))
    return np.unique(np.concatenate([low, high, [len(value) - 1]]))
