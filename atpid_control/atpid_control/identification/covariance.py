# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From the converged fit to the estimate: amplitude, phase and their standard deviations, residual, harmonics."""

import numpy as np

from atpid_control.identification import columns as col
from atpid_control.identification.choice import FLOOR, Flags, chosen_columns, residual_of
from atpid_control.identification.coloured import widening
from atpid_control.identification.linear import compiled, dot, factor, gram, inverse_corner, least_squares
from atpid_sim.system import Array

OK, AMPLITUDE, A_STD, OMEGA, O_STD, PHASE, P_STD = 0, 1, 2, 3, 4, 5, 6
OFFSET, RESIDUAL, CONTENT, SLOPE, SLOPE_STD, USED, CHANGE, DRIFT = 7, 8, 9, 10, 11, 12, 13, 14
WIDENED, FOREIGN = 15, 16
RESULTS = 17
#: From this share of readings equal to the one before their step is coarse [-].
COARSE = 0.05


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
    c = inverse_corner(lower, chosen.size, 4)
    amplitude = np.hypot(a, b)
    if not amplitude > 0.0:
        return
    along, across = a / amplitude, b / amplitude
    out[AMPLITUDE] = amplitude
    spread = along * along * c[0, 0] + 2.0 * along * across * c[0, 1] + across * across * c[1, 1]
    out[A_STD] = np.sqrt(variance * spread)
    out[OMEGA] = omega
    out[O_STD] = np.sqrt(variance * c[3, 3]) / (amplitude * scale)
    out[PHASE] = np.arctan2(a, b) - omega * centre
    # phase = atan2(a, b) + omega (end - centre): gradient with respect to a, b and the scaled rate
    g0, g1, g3 = b / amplitude**2, -a / amplitude**2, -centre / (amplitude * scale)
    out[P_STD] = np.sqrt(variance * (g0 * g0 * c[0, 0] + g1 * g1 * c[1, 1] + g3 * g3 * c[3, 3]
                                      + 2.0 * (g0 * g1 * c[0, 1] + g0 * g3 * c[0, 3] + g1 * g3 * c[1, 3])))  # fmt: skip
    out[WIDENED], out[FOREIGN], periods = 1.0, np.inf, omega * scale / np.pi
    if out[CHANGE] == 0.0 and variance > (FLOOR * amplitude) ** 2:
        gradients = np.zeros((3, chosen.size))
        gradients[0, 0], gradients[0, 1], gradients[1, 3] = along, across, 1.0 / (amplitude * scale)
        gradients[2, 0], gradients[2, 1], gradients[2, 3] = g0, g1, g3
        factors, plain = widening(columns, chosen, left, lower, gradients, 2.0 * np.pi * periods)
        for k, place in enumerate((A_STD, O_STD, P_STD)):
            out[place] *= factors[k]
        out[WIDENED], out[FOREIGN] = factors.max(), np.inf if plain else np.sqrt(variance)
        rounding = _rounding(y, variance, amplitude, periods)
        if rounding > 0.0:
            out[A_STD] = np.sqrt(out[A_STD] ** 2 + rounding)
    end = centre / scale
    out[OFFSET] = tone[2 + col.ONE] - tone[2 + col.DRIFT] * end + tone[2 + col.CURVE] * (end * end - 1.0 / 3.0)
    out[RESIDUAL] = np.sqrt(variance)
    out[CONTENT] = _harmonic_content(columns, left, tone, active, variance)
    out[USED] = n
    out[SLOPE], out[SLOPE_STD] = _slope(columns, left, active, variance)
    out[SLOPE] /= amplitude
    out[SLOPE_STD] /= amplitude
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
    if moved > (1.0 - COARSE) * (y.size - 1) or moved == 0 or variance > least**2 / 8.0:
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
    return solution[0], np.sqrt(variance * inverse_corner(lower, chosen.size, 1)[0, 0])


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
