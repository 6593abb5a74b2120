# SPDX-License-Identifier: Apache-2.0
"""Runge-Kutta pairs the thesis compared that scipy does not have: (A, b, error weights, order of the error)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Tableau(NamedTuple):
    """An explicit pair: stages (s, s), nodes (s,), weights (s,), weights less embedded ones (s,), order of error."""

    stages: Array
    nodes: Array
    weights: Array
    error: Array
    order: int


def _pair(rows: list[list[float]], weights: list[float], embedded: list[float], order: int) -> Tableau:
    count = len(weights)
    stages = np.zeros((count, count))
    for row, values in enumerate(rows, start=1):
        stages[row, : len(values)] = values
    b, e = np.array(weights), np.array(embedded)
    return Tableau(stages, stages.sum(axis=1), b, b - e, order)


#: Cash and Karp, ACM Trans. Math. Softw. 16 (1990) 201: fifth order, embedded fourth.
CASH_KARP = _pair(
    [
        [1 / 5],
        [3 / 40, 9 / 40],
        [3 / 10, -9 / 10, 6 / 5],
        [-11 / 54, 5 / 2, -70 / 27, 35 / 27],
        [1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096],
    ],
    [37 / 378, 0.0, 250 / 621, 125 / 594, 0.0, 512 / 1771],
    [2825 / 27648, 0.0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4],
    5,
)

#: Fehlberg, NASA TR R-315 (1969): the solution steps with the fourth order, as RKF45 does.
FEHLBERG = _pair(
    [
        [1 / 4],
        [3 / 32, 9 / 32],
        [1932 / 2197, -7200 / 2197, 7296 / 2197],
        [439 / 216, -8.0, 3680 / 513, -845 / 4104],
        [-8 / 27, 2.0, -3544 / 2565, 1859 / 4104, -11 / 40],
    ],
    [25 / 216, 0.0, 1408 / 2565, 2197 / 4104, -1 / 5, 0.0],
    [16 / 135, 0.0, 6656 / 12825, 28561 / 56430, -9 / 50, 2 / 55],
    4,
)
