# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From the converged fit to the estimate: amplitude, phase and their standard deviations, residual, harmonics.

Noise that is not white is described as white and first-order autoregressive noise together, for a grid of memories and
shares. A Kalman filter whitens residual and columns under each and gives its restricted likelihood (Harville, J. Am.
Stat. Assoc. 72, 1977). Their mean over that of white noise is a Bayes factor, whose expectation under white noise is
one. Where it exceeds `_EVIDENCE` (under white noise in one of 700 windows) the bars are the largest that a likely noise
gives.

A tone whose frequency drifts slowly is described by its rate, and can be acted on like a steady one: over two periods a
drift of 1 % a second bends the phase by 3 milliradians, at 60 dB no steady tone any more, and no other excitation
either. The estimate is then that of the window's end.
"""

import numpy as np

from atpid_control.identification import columns as col
from atpid_control.identification import linear
from atpid_control.identification.choice import FLOOR, Flags, best_group, chosen_columns, residual_of
from atpid_control.identification.linear import Indices, compiled, dot, explained, factor, gram, least_squares
from atpid_sim.system import Array

#: Least number of blocks in which a window is averaged; memories of the noise in blocks, its variance over the white's.
_BLOCKS, _MEMORIES, _SHARES = 128, (1.0, 3.0, 10.0, 30.0, 100.0), (0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1000.0)
#: Likelihood over that of white noise from which noise is not white; log-likelihood down to which one is likely.
_EVIDENCE, _LIKELY = 20.0, 1.5
#: Share from which white noise is next to nothing; correlation with the past from which a residual is examined.
_ALONE, _EXAMINED = 100.0, 0.05


@compiled
def _widening(
    columns: Array, chosen: Indices, left: Array, lower: Array, gradients: Array, turns: float
) -> tuple[Array, bool]:
    """Return by what factors (k,) standard deviations exceed those under white noise, and whether a change would show.

    left: residual (n,) [m] of the chosen columns; lower: factor of their normal equations; gradients (k, p): of the
    quantities with respect to their coefficients; turns: phase of the tone over the window [rad]. The factors are 1
    where the residual is white. Noise slower than the tone and almost without a white part wanders as a tone changes.
    """
    factors, plain, size = np.ones(gradients.shape[0]), True, chosen.size
    stride = max(1, left.size // _BLOCKS)
    rows = np.empty((size + 1, left.size // stride))
    _write_blocks(left, stride, rows[size])
    last, keep, past, joint = rows[size], np.exp(-1.0 / _MEMORIES[1]), 0.0, 0.0
    for value in last:
        joint += past * value
        past = keep * (past + value)
    if not joint > _EXAMINED * dot(last, last):
        return factors, plain
    for i in range(size):
        _write_blocks(columns[chosen[i]], stride, rows[i])
    noises, white = _likely_noises(rows), dot(left, left) / (left.size - size)
    for noise in range(len(noises)):
        memory, share, variance = noises[noise, 0], noises[noise, 1], noises[noise, 3]
        plain &= memory * turns <= last.size or share < _ALONE
        for k in range(factors.size):
            weights = gradients[k].copy()
            linear.substitute(lower, size, weights)
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
    noises, likely = np.empty((len(_MEMORIES) * len(_SHARES), 4)), 0
    highest, evidence = -np.inf, 0.0
    for noise in range(len(noises)):
        memory, share = _MEMORIES[noise // len(_SHARES)], _SHARES[noise % len(_SHARES)]
        noises[noise, 0], noises[noise, 1] = memory, share
        noises[noise, 2], noises[noise, 3] = _likelihood(rows, np.exp(-1.0 / memory), share)
        highest = max(highest, noises[noise, 2])
    for noise in range(len(noises)):
        evidence += np.exp(noises[noise, 2] - highest) / len(noises)
    if highest + np.log(evidence) <= _likelihood(rows, 0.0, 0.0)[0] + np.log(_EVIDENCE):
        return noises[:0]
    for noise in range(len(noises)):
        if noises[noise, 2] >= highest - _LIKELY:
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


OK, _AMPLITUDE, _A_STD, OMEGA, _O_STD, PHASE, _P_STD = 0, 1, 2, 3, 4, 5, 6
_OFFSET, _RESIDUAL, _CONTENT, _SLOPE, _SLOPE_STD, USED, CHANGE, _DRIFT = 7, 8, 9, 10, 11, 12, 13, 14
WIDENED, FOREIGN = 15, 16
RESULTS = 17
#: From this share of readings equal to the one before their step is coarse [-].
_COARSE = 0.05


@compiled
def report(out: Array, columns: Array, y: Array, tone: Array, scale: float, centre: float, active: Flags) -> None:
    """Write the estimate and its standard deviations from the covariance of the model that was chosen.

    In a steady window the noise need not be white: WIDENED and, where it hides changes, FOREIGN tell it.
    """
    chosen = chosen_columns(active)
    omega, a, b, n = tone[1], tone[2], tone[3], y.size
    col.write_harmonics(columns)
    left = residual_of(columns, y, tone, active)
    matrix, lower = np.zeros((col.COUNT, col.COUNT)), np.zeros((col.COUNT, col.COUNT))
    gram(columns, chosen, matrix)
    if n <= chosen.size or not factor(matrix, chosen, lower):
        return
    variance = dot(left, left) / (n - chosen.size)
    c = linear.inverse_corner(lower, chosen.size, 4)
    amplitude = np.hypot(a, b)
    if not amplitude > 0.0:
        return
    along, across = a / amplitude, b / amplitude
    out[_AMPLITUDE] = amplitude
    spread = along * along * c[0, 0] + 2.0 * along * across * c[0, 1] + across * across * c[1, 1]
    out[_A_STD] = np.sqrt(variance * spread)
    out[OMEGA] = omega
    out[_O_STD] = np.sqrt(variance * c[3, 3]) / (amplitude * scale)
    out[PHASE] = np.arctan2(a, b) - omega * centre
    # phase = atan2(a, b) + omega (end - centre): gradient with respect to a, b and the scaled rate
    g0, g1, g3 = b / amplitude**2, -a / amplitude**2, -centre / (amplitude * scale)
    out[_P_STD] = np.sqrt(
        variance
        * (
            g0 * g0 * c[0, 0]
            + g1 * g1 * c[1, 1]
            + g3 * g3 * c[3, 3]
            + 2.0 * (g0 * g1 * c[0, 1] + g0 * g3 * c[0, 3] + g1 * g3 * c[1, 3])
        )
    )
    out[WIDENED], out[FOREIGN], periods = 1.0, np.inf, omega * scale / np.pi
    if out[CHANGE] == 0.0 and variance > (FLOOR * amplitude) ** 2:
        gradients = np.zeros((3, chosen.size))
        gradients[0, 0], gradients[0, 1], gradients[1, 3] = along, across, 1.0 / (amplitude * scale)
        gradients[2, 0], gradients[2, 1], gradients[2, 3] = g0, g1, g3
        factors, plain = _widening(columns, chosen, left, lower, gradients, 2.0 * np.pi * periods)
        for k, place in enumerate((_A_STD, _O_STD, _P_STD)):
            out[place] *= factors[k]
        out[WIDENED], out[FOREIGN] = factors.max(), np.inf if plain else np.sqrt(variance)
        rounding = _rounding(y, variance, amplitude, periods)
        if rounding > 0.0:
            out[_A_STD] = np.sqrt(out[_A_STD] ** 2 + rounding)
    end = centre / scale
    out[_OFFSET] = tone[2 + col.ONE] - tone[2 + col.DRIFT] * end + tone[2 + col.CURVE] * (end * end - 1.0 / 3.0)
    out[_RESIDUAL] = np.sqrt(variance)
    out[_CONTENT] = _harmonic_content(columns, left, tone, active, variance)
    out[USED] = n
    out[_SLOPE], out[_SLOPE_STD] = _slope(columns, left, active, variance)
    out[_SLOPE] /= amplitude
    out[_SLOPE_STD] /= amplitude
    out[OK] = 1.0


@compiled
def _rounding(y: Array, variance: float, amplitude: float, periods: float) -> float:
    """Return the variance [m^2] that a coarse step q of the readings (n,) adds to the amplitude's; 0: none.

    Without noise of q / sqrt(12) a crest is read as one value for sqrt(2 q / A) / pi of a period, with one error in all
    of it. For crests anywhere between two readings, and the fit's weights 2 / n, that makes q^3 / (45 A) a period.
    """
    moved, least = 0, np.inf
    for i in range(1, y.size):
        step = abs(y[i] - y[i - 1])
        if step > 0.0:
            moved, least = moved + 1, min(least, step)
    if moved > (1.0 - _COARSE) * (y.size - 1) or moved == 0 or variance > least**2 / 8.0:
        return 0.0
    return float(least**3 / (45.0 * amplitude * periods))


@compiled
def _slope(columns: Array, left: Array, active: Flags, variance: float) -> tuple[float, float]:
    """Return the change of amplitude over half the window [m] and its standard deviation, phase and rest fitted too."""
    base = chosen_columns(active)
    chosen = np.empty(base.size + 1, dtype=np.int64)
    chosen[0] = col.SLOPE
    for k in range(base.size):
        chosen[k + 1] = base[k]
    independent, solution, lower = least_squares(columns, chosen, left)
    if not independent:
        return 0.0, np.inf
    return solution[0], np.sqrt(variance * linear.inverse_corner(lower, chosen.size, 1)[0, 0])


@compiled
def _harmonic_content(columns: Array, left: Array, tone: Array, active: Flags, variance: float) -> float:
    """Return the harmonics' root power relative to the amplitude, what noise would show taken off."""
    trial = active.copy()
    trial[1] = True
    chosen = chosen_columns(trial)
    independent, solution, _ = least_squares(columns, chosen, left)
    if not independent:
        return 0.0
    power = 0.0
    for i in range(chosen.size):
        if col.HARMONICS <= chosen[i] < col.HUM:
            value = solution[i] + tone[2 + chosen[i]]
            power += value * value - 2.0 * variance / left.size
    return float(np.sqrt(max(power, 0.0)) / np.hypot(tone[2], tone[3]))


#: Place of the group of columns with which amplitude and frequency change at constant rates.
_RATES = 3
#: Change of the amplitude over half a window up to which only the frequency drifts [-].
_LEVEL = 0.005


@compiled
def follow_drift(
    out: Array,
    columns: Array,
    t: Array,
    y: Array,
    tone: Array,
    of_window: tuple[float, float],
    active: Flags,
    limits: tuple[float, float],
    group: int,
) -> None:
    """Where the change found in a window is a slow drift alone, write estimate and rate in place of the change.

    out: the report of the steady model, whose phase, frequency and amplitude become those of the window's end;
    of_window: angular frequency of the hum [rad/s] and half the window [s]; limits: largest relative rate [1/s], and
    the log-likelihood from which something else than the drift changes, too; group: of columns that describes the
    change best.
    """
    (hum, scale), (slow, threshold) = of_window, limits
    if not (group == _RATES and slow > 0.0 and out[OK] > 0.0 and out[CHANGE] > 0.0):
        return
    rates = active.copy()
    rates[_RATES] = True
    chosen = chosen_columns(rates)
    independent, solution, lower = least_squares(columns, chosen, residual_of(columns, y, tone, active))
    if t.size <= chosen.size or not independent:
        return
    bent = tone.copy()
    for k in range(chosen.size):
        bent[2 + chosen[k]] += solution[k]
    a, b = bent[2], bent[3]
    amplitude = np.hypot(a, b)
    if not amplitude > 0.0:
        return
    bend = bent[2 + col.SLOPE + 1] / amplitude  # phase by it at the window's ends [rad]
    omega = tone[1] + bent[2 + col.PHASE_RATE] / (amplitude * scale)
    rate = 2.0 * bend / (scale * scale * omega)
    if not (abs(rate) <= slow and abs(bent[2 + col.SLOPE]) <= _LEVEL * amplitude):
        return
    best, gain = best_group(columns, t, y, bent, hum, scale, scale, rates)
    if best >= col.STEADY_GROUPS and gain >= threshold:
        return
    left = residual_of(columns, y, bent, rates)
    variance = dot(left, left) / (t.size - chosen.size)
    gradient = np.zeros(col.COUNT)
    gradient[0], gradient[1] = a / amplitude, b / amplitude
    wider = _widening(columns, chosen, left, lower, gradient[chosen].reshape(1, -1), 0.0)[0][0]
    if wider > 1.0 and variance > (FLOOR * amplitude) ** 2:  # a drift cannot be distinguished from such noise
        return
    out[_AMPLITUDE], out[_A_STD] = amplitude, np.sqrt(variance * explained(lower, gradient, chosen))
    gradient[:] = 0.0
    gradient[col.PHASE_RATE], gradient[col.SLOPE + 1] = 1.0 / (amplitude * scale), 2.0 / (amplitude * scale)
    out[OMEGA] = omega + 2.0 * bend / scale
    out[_O_STD] = np.sqrt(variance * explained(lower, gradient, chosen))
    gradient[0], gradient[1] = b / amplitude**2, -a / amplitude**2
    gradient[col.PHASE_RATE], gradient[col.SLOPE + 1] = 1.0 / amplitude, 1.0 / amplitude
    out[PHASE] = np.arctan2(a, b) + omega * scale + bend
    out[_P_STD] = np.sqrt(variance * explained(lower, gradient, chosen))
    out[_RESIDUAL], out[_DRIFT], out[CHANGE] = np.sqrt(variance), rate, 0.0
