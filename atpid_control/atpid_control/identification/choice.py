# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which groups of columns describe a window: decided by how much of the residual each explains."""

import numpy as np
from numpy.typing import NDArray

from atpid_control.identification import columns as col
from atpid_control.identification.linear import compiled, dot, explained, factor, gram, project
from atpid_sim.system import Array

Flags = NDArray[np.bool_]

#: A sample this many robust standard deviations off the fit is a spike, and left out.
_SPIKE = 6.0
#: Above this share of the samples outliers are not spikes but a signal the model does not describe.
_SPIKES_AT_MOST = 0.15
#: A misfit below this share of the amplitude is not a change: it is within the accuracy of sensors and arithmetic.
FLOOR = 1e-4
#: Log-likelihood every further parameter has to bring before a group may join.
PENALTY = 6.0
#: Harmonics cannot be distinguished from a change within less than this many periods.
HARMONICS_FROM = 1.5


@compiled
def chosen_columns(active: Flags) -> NDArray[np.int64]:
    """Return the columns of the base and of the groups that joined."""
    chosen, count = np.arange(col.COUNT), col.BASE
    for g in range(len(col.GROUPS)):
        for k in range(col.GROUPS[g][0], col.GROUPS[g][1]):
            if active[g]:
                chosen[count] = k
                count += 1
    return chosen[:count]


@compiled
def residual_of(columns: Array, y: Array, tone: Array, active: Flags) -> Array:
    """Return signal minus fit (n,), the columns of the tone being up to date."""
    left = y.copy()
    chosen = chosen_columns(active)
    for k in range(chosen.size):
        value = tone[2 + chosen[k]]
        if value != 0.0:
            column = columns[chosen[k]]
            for i in range(left.size):
                left[i] -= value * column[i]
    return left


@compiled
def without_spikes(
    columns: Array, signal: Array, tone: Array, scale: float, active: Flags, keep: Flags
) -> tuple[Flags, bool]:
    """Return the inlier mask (n,), and whether the outliers are spikes.

    `columns` are those of all samples, `keep` marks the ones that took part in the fit.
    """
    count = signal.size
    off = np.abs(residual_of(columns, signal, tone, active))
    limit = _SPIKE * 1.4826 * np.median(off[keep]) + 1e-9 * np.hypot(tone[2], tone[3])
    fresh = off <= limit
    longest = max(6.0, 0.06 * count * 2.0 * np.pi / (tone[1] * 2.0 * scale))
    spikes, run = 0, 0
    for i in range(count):
        run = 0 if fresh[i] else run + 1
        spikes += 0 if fresh[i] else 1
        if run > longest:
            return fresh, False
    return fresh, spikes <= _SPIKES_AT_MOST * count


@compiled
def _allowed(active: Flags, omega: float, hum: float, scale: float, step: float) -> Flags:
    """Return the groups that may join: independent of what is there, and below the sampling's limit."""
    allowed = ~active
    periods = omega * scale / np.pi
    allowed[1] &= periods >= HARMONICS_FROM and col.HIGHEST_HARMONIC * omega * step < 0.9 * np.pi
    nearest = abs(hum / omega - min(max(np.round(hum / omega), 1.0), float(col.HIGHEST_HARMONIC))) * periods
    allowed[2] &= hum > 0.0 and hum * step < 0.9 * np.pi and nearest > 1.0
    allowed[col.CURVED] = False
    for group in col.LONG_GROUPS:
        allowed[group] &= periods >= HARMONICS_FROM
    return allowed


@compiled
def best_group(
    columns: Array, t: Array, y: Array, tone: Array, hum: float, scale: float, end: float, active: Flags
) -> tuple[int, float]:
    """Return the group that describes the residual best and its log-likelihood; -1 where none is significant."""
    omega, n = tone[1], t.size
    col.write_harmonics(columns)
    col.write_changes(columns, t, end, 2.0 * np.pi / omega, tone[2], tone[3], scale)
    allowed = _allowed(active, omega, hum, scale, 2.0 * scale / n)
    left = residual_of(columns, y, tone, active)
    everything = np.arange(col.COUNT)
    matrix, vector = np.zeros((col.COUNT, col.COUNT)), np.zeros(col.COUNT)
    gram(columns, everything, matrix)
    project(columns, everything, left, vector)
    total = dot(left, left) + n * FLOOR * FLOOR * (tone[2] * tone[2] + tone[3] * tone[3])
    lower = np.zeros((col.COUNT, col.COUNT))
    best, highest = -1, 0.0
    for g in range(len(col.GROUPS)):
        if not allowed[g]:
            continue
        trial = active.copy()
        trial[g] = True
        chosen = chosen_columns(trial)
        if not factor(matrix, chosen, lower):
            continue
        ratio = total / max(total - explained(lower, vector, chosen), 1e-300)
        freedom = n - chosen.size
        gain = 0.5 * freedom * np.log(ratio) - PENALTY * (col.GROUPS[g][1] - col.GROUPS[g][0])
        if g < col.STEADY_GROUPS:
            gain -= PENALTY
        if gain > highest:
            best, highest = g, gain
    return best, highest


@compiled
def foreign_residual(
    columns: Array, t: Array, y: Array, tone: Array, scale: float, active: Flags, gain: float
) -> float:
    """Return what a subharmonic, or crests that a sensor cut off, leave of `y` [m] if they describe it best, else inf.

    Harmonics, drift and changes take most of either. gain: of the change that was found, 0: none, as `best_group`
    returns it. Columns of changes are overwritten.
    """
    amplitude = np.hypot(tone[2], tone[3])
    highest, least = _described(columns, y, amplitude, active)[0] + gain + PENALTY, np.inf
    for cut in range(0, 50, 5):  # half of the time a crest is cut off, in degrees of the tone; 0: the subharmonic
        trial = active.copy()
        trial[col.FIRST_RECENT] = True
        if cut > 0:
            trial[1], level = False, np.cos(np.radians(cut))
            for i in range(t.size):
                unit = (tone[2] * columns[col.COSINE, i] + tone[3] * columns[col.SINE, i]) / amplitude
                columns[col.RECENT, i], columns[col.RECENT + 1, i] = max(unit, level), min(unit, -level)
        elif tone[1] * scale >= np.pi * HARMONICS_FROM:
            trial[0] = trial[col.CURVED] = False  # much like half a cycle of it
            for i in range(t.size):
                half = 0.5 * tone[1] * t[i]
                columns[col.RECENT, i], columns[col.RECENT + 1, i] = np.cos(half), np.sin(half)
        else:
            continue
        score, left = _described(columns, y, amplitude, trial)
        if score > highest:
            highest, least = score, left
    return least


@compiled
def _described(columns: Array, y: Array, amplitude: float, active: Flags) -> tuple[float, float]:
    """Return the log-likelihood of the active columns, less the penalty for each, and the residual they leave [m]."""
    chosen, vector = chosen_columns(active), np.zeros(col.COUNT)
    matrix, lower = np.zeros((col.COUNT, col.COUNT)), np.zeros((col.COUNT, col.COUNT))
    gram(columns, chosen, matrix)
    project(columns, chosen, y, vector)
    free = y.size - chosen.size
    if free <= 0 or not factor(matrix, chosen, lower):
        return -np.inf, np.inf
    left = max(dot(y, y) - explained(lower, vector, chosen), 0.0)
    score = -0.5 * free * np.log(left + y.size * (FLOOR * amplitude) ** 2) - PENALTY * chosen.size
    return score, np.sqrt(left / free)
