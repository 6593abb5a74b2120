# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Error bars in noise that is not white: where the residual shows it, and only there.

The noise is described as white and first-order autoregressive noise together, for a grid of memories and shares. A
Kalman filter whitens residual and columns under each and gives its restricted likelihood (Harville, J. Am. Stat. Assoc.
72, 1977). Their mean over that of white noise is a Bayes factor, whose expectation under white noise is one. Where it
exceeds `EVIDENCE` (under white noise in one of 700 windows) the bars are the largest that a likely noise gives.
"""

import numpy as np

from atpid_control.identification.linear import Indices, compiled, dot, factor, gram, substitute
from atpid_sim.system import Array

#: Least number of blocks in which a window is averaged; memories of the noise in blocks, its variance over the white's.
BLOCKS, MEMORIES, SHARES = 128, (1.0, 3.0, 10.0, 30.0, 100.0), (0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1000.0)
#: Likelihood over that of white noise from which noise is not white; log-likelihood down to which one is likely.
EVIDENCE, LIKELY = 20.0, 1.5
#: Share from which white noise is next to nothing; correlation with the past from which a residual is examined.
ALONE, EXAMINED = 100.0, 0.05


@compiled
def widening(
    columns: Array, chosen: Indices, left: Array, lower: Array, gradients: Array, turns: float
) -> tuple[Array, bool]:
    """Return by what factors (k,) standard deviations exceed those under white noise, and whether a change would show.

    left: residual (n,) [m] of the chosen columns; lower: factor of their normal equations; gradients (k, p): of the
    quantities with respect to their coefficients; turns: phase of the tone over the window [rad]. The factors are 1
    where the residual is white. Noise slower than the tone and almost without a white part wanders as a tone changes.
    """
    factors, plain, size = np.ones(gradients.shape[0]), True, chosen.size
    stride = max(1, left.size // BLOCKS)
    rows = np.empty((size + 1, left.size // stride))
    _write_blocks(left, stride, rows[size])
    last, keep, past, joint = rows[size], np.exp(-1.0 / MEMORIES[1]), 0.0, 0.0
    for value in last:
        joint += past * value
        past = keep * (past + value)
    if not joint > EXAMINED * dot(last, last):
        return factors, plain
    for i in range(size):
        _write_blocks(columns[chosen[i]], stride, rows[i])
    noises, white = _likely_noises(rows), dot(left, left) / (left.size - size)
    for noise in range(len(noises)):
        memory, share, variance = noises[noise, 0], noises[noise, 1], noises[noise, 3]
        plain &= memory * turns <= last.size or share < ALONE
        for k in range(factors.size):
            weights = gradients[k].copy()
            substitute(lower, size, weights)
            past, joint, own = 0.0, 0.0, 0.0
            for j in range(last.size):
                effect = 0.0
                for i in range(size):
                    effect += weights[i] * rows[i, j]
                own += effect * effect
                joint += 2.0 * past * effect
                past = np.exp(-1.0 / memory) * (past + effect)
            factors[k] = max(factors[k], np.sqrt(variance / white * (1.0 + share * (1.0 + joint / own))))
    return factors, plain


@compiled
def _likely_noises(rows: Array) -> Array:
    """Return memory, share, log-likelihood and white variance [m^2] of the likely noises (m, 4); of none where white.

    rows: as in `_likelihood`.
    """
    noises, likely = np.empty((len(MEMORIES) * len(SHARES), 4)), 0
    highest, evidence = -np.inf, 0.0
    for noise in range(len(noises)):
        memory, share = MEMORIES[noise // len(SHARES)], SHARES[noise % len(SHARES)]
        noises[noise, 0], noises[noise, 1] = memory, share
        noises[noise, 2], noises[noise, 3] = _likelihood(rows, np.exp(-1.0 / memory), share)
        highest = max(highest, noises[noise, 2])
    for noise in range(len(noises)):
        evidence += np.exp(noises[noise, 2] - highest) / len(noises)
    if highest + np.log(evidence) <= _likelihood(rows, 0.0, 0.0)[0] + np.log(EVIDENCE):
        return noises[:0]
    for noise in range(len(noises)):
        if noises[noise, 2] >= highest - LIKELY:
            for k in range(4):
                noises[likely, k] = noises[noise, k]
            likely += 1
    return noises[:likely]


@compiled
def _write_blocks(values: Array, stride: int, out: Array) -> None:
    """Write the sums of `stride` values each, up to the newest, over the root of their number, into `out` (blocks,)."""
    first = values.size % stride
    for j in range(out.size):
        total = 0.0
        for i in range(first + j * stride, first + (j + 1) * stride):
            total += values[i]
        out[j] = total / np.sqrt(stride)


@compiled
def _likelihood(rows: Array, keep: float, share: float) -> tuple[float, float]:
    """Return the restricted log-likelihood, but for a constant, and the variance of the white part [m^2].

    rows (p + 1, b): columns and residual; keep: what noise of `share` times the white one's variance has of its last.
    """
    (every, count), white = rows.shape, np.empty_like(rows)
    past, spread, logs = np.zeros(every), share, 0.0
    for j in range(count):
        logs += np.log(spread + 1.0)
        gain = spread / (spread + 1.0)
        for i in range(every):
            off = rows[i, j] - past[i]
            white[i, j] = off / np.sqrt(spread + 1.0)
            past[i] = keep * (past[i] + gain * off)
        spread = keep * keep * gain + share * (1.0 - keep * keep)
    matrix, lower, free = np.zeros((every, every)), np.zeros((every, every)), count - every + 1
    gram(white, np.arange(every), matrix)
    if not factor(matrix, np.arange(every), lower):
        return -np.inf, 0.0
    for i in range(every - 1):
        logs += 2.0 * np.log(lower[i, i])
    last = lower[every - 1, every - 1]
    return -0.5 * logs - free * np.log(last), last**2 / (free - 2.0)
