# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runge-Kutta over one drive row, adaptive or with fixed steps, compiled: methods of the thesis that scipy lacks."""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.engine.columns import END, START
from atpid_sim.kernel import kernel
from atpid_sim.system import Array
from studies.baselines.rhs import BEAM, BEAM_VELOCITY, GRAIN, GRAIN_VELOCITY, INPUT, WORK, drive_at, powers


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


@kernel
def _slope(tau, y, q, k, i):
    """Write the slope of y (6,) to row i of k (s, 6)."""
    x, v, z, w = y[BEAM], y[BEAM_VELOCITY], y[GRAIN], y[GRAIN_VELOCITY]
    k[i, BEAM], k[i, GRAIN] = v, w
    k[i, BEAM_VELOCITY], k[i, GRAIN_VELOCITY], k[i, INPUT], k[i, WORK] = powers(x, v, z, w, drive_at(tau, q), q)


@kernel
def _attempt(tau, h, y, q, pair, k, new):
    """Fill the slopes k (s, 6), k[0] given, and leave y + h b k in `new`."""
    a, c, b = pair.stages, pair.nodes, pair.weights
    for i in range(1, b.shape[0]):
        for j in range(4):
            total = 0.0
            for m in range(i):
                total += a[i, m] * k[m, j]
            new[j] = y[j] + h * total
        _slope(tau + c[i] * h, new, q, k, i)
    for j in range(6):
        total = 0.0
        for m in range(b.shape[0]):
            total += b[m] * k[m, j]
        new[j] = y[j] + h * total


@kernel
def _error(h, y, new, k, d, rtol, atol):
    """Largest error of the step over what is allowed; the integrals do not count."""
    worst = 0.0
    for j in range(4):
        total = 0.0
        for m in range(d.shape[0]):
            total += d[m] * k[m, j]
        ratio = abs(h * total) / (atol + rtol * max(abs(y[j]), abs(new[j])))
        if not ratio <= worst:
            worst = ratio
    return worst


@kernel
def adaptive_row(q, pair, rtol, atol, longest, y, h, budget, kept):
    """Integrate y (6,) through the row packed in q (24,) with error control.

    Return (next step, steps tried, points kept).

    No step of the `pair`, a Tableau, is longer than `longest` [s]; after `budget` steps it stops. Step ends go to
    `kept` (n, 5): t, x, v, acceleration, grain.
    """
    k = np.zeros((pair.weights.shape[0], 6))
    new = np.zeros(6)
    tau, length, tried = 0.0, q[END] - q[START], 0
    _slope(tau, y, q, k, 0)
    fill = _keep(kept, 0, q[START], y[BEAM], y[BEAM_VELOCITY], k[0, BEAM_VELOCITY], y[GRAIN])
    while tau < length and tried < budget:
        h = min(h, longest)
        last = tau + h >= length * (1.0 - 1e-15)
        step = length - tau if last else h
        _attempt(tau, step, y, q, pair, k, new)
        worst = _error(step, y, new, k, pair.error, rtol, atol)
        tried += 1
        if not worst <= 1.0:
            h = step * (max(0.2, 0.9 * worst ** (-1.0 / pair.order)) if math.isfinite(worst) else 0.2)
            continue
        tau = length if last else tau + step
        y[:] = new
        _slope(tau, y, q, k, 0)
        fill = _keep(kept, fill, q[START] + tau, y[BEAM], y[BEAM_VELOCITY], k[0, BEAM_VELOCITY], y[GRAIN])
        grown = step * min(5.0, 0.9 * max(worst, 1e-10) ** (-1.0 / pair.order))
        h = max(h, grown) if last else grown
    return h, tried, fill


@kernel
def classical_row(q, step, y, stride, kept):
    """Integrate y (6,) through the row packed in q (24,) in equal steps of about `step` [s].

    Return (steps, points kept).

    The classical method of fourth order, written out: its stages need no table. Every `stride`-th point is kept.
    """
    length = q[END] - q[START]
    count = max(1, math.ceil(length / step - 1e-9))
    h = length / count
    x, v, z, w, given, work = y
    fill = 0
    start = drive_at(0.0, q)
    for i in range(count):
        middle, end = drive_at((i + 0.5) * h, q), drive_at((i + 1) * h, q)
        a1, g1, i1, p1 = powers(x, v, z, w, start, q)
        if i % stride == 0:
            fill = _keep(kept, fill, q[START] + i * h, x, v, a1, z)
        v2, w2 = v + 0.5 * h * a1, w + 0.5 * h * g1
        a2, g2, i2, p2 = powers(x + 0.5 * h * v, v2, z + 0.5 * h * w, w2, middle, q)
        v3, w3 = v + 0.5 * h * a2, w + 0.5 * h * g2
        a3, g3, i3, p3 = powers(x + 0.5 * h * v2, v3, z + 0.5 * h * w2, w3, middle, q)
        v4, w4 = v + h * a3, w + h * g3
        a4, g4, i4, p4 = powers(x + h * v3, v4, z + h * w3, w4, end, q)
        x += h * (v + 2.0 * (v2 + v3) + v4) / 6.0
        z += h * (w + 2.0 * (w2 + w3) + w4) / 6.0
        v += h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0
        w += h * (g1 + 2.0 * (g2 + g3) + g4) / 6.0
        given += h * (i1 + 2.0 * (i2 + i3) + i4) / 6.0
        work += h * (p1 + 2.0 * (p2 + p3) + p4) / 6.0
        start = end
    y[BEAM], y[BEAM_VELOCITY], y[GRAIN], y[GRAIN_VELOCITY], y[INPUT], y[WORK] = x, v, z, w, given, work
    a1, _g, _i, _p = powers(x, v, z, w, start, q)
    return count, _keep(kept, fill, q[END], x, v, a1, z)


@kernel
def _keep(kept, fill, t, x, v, a, z):
    """Write time, x, v, acceleration and grain to row `fill` while there is space; return the next row."""
    if fill < kept.shape[0]:
        kept[fill, 0], kept[fill, 1], kept[fill, 2], kept[fill, 3], kept[fill, 4] = t, x, v, a, z
        fill += 1
    return fill
