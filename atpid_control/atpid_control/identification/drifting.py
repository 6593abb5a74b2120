# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A tone whose frequency drifts slowly: described by its rate, it can be acted on like a steady one.

Over two periods a drift of 1 % a second bends the phase by 3 milliradians. At 60 dB that is no steady tone any more,
and no other excitation either: with the rate in the model the estimate is that of the window's end.
"""

import numpy as np

from atpid_control.identification import columns as col
from atpid_control.identification.choice import FLOOR, Flags, best_group, chosen_columns, residual_of
from atpid_control.identification.coloured import widening
from atpid_control.identification.covariance import (
    A_STD,
    AMPLITUDE,
    CHANGE,
    DRIFT,
    O_STD,
    OK,
    OMEGA,
    P_STD,
    PHASE,
    RESIDUAL,
)  # fmt: skip
from atpid_control.identification.linear import compiled, dot, explained, least_squares
from atpid_sim.system import Array

#: Place of the group of columns with which amplitude and frequency change at constant rates.
RATES = 3
#: Change of the amplitude over half a window up to which only the frequency drifts [-].
_LEVEL = 0.005


@compiled
def follow_drift(
    out: Array, columns: Array, t: Array, y: Array, tone: Array, of_window: tuple[float, float], active: Flags,
    limits: tuple[float, float], group: int,
) -> None:  # fmt: skip
    """Where the change found in a window is a slow drift alone, write estimate and rate in place of the change.

    out: the report of the steady model, whose phase, frequency and amplitude become those of the window's end;
    of_window: angular frequency of the hum [rad/s] and half the window [s]; limits: largest relative rate [1/s], and
    the log-likelihood from which something else than the drift changes, too; group: of columns that describes the
    change best.
    """
    (hum, scale), (slow, threshold) = of_window, limits
    if not (group == RATES and slow > 0.0 and out[OK] > 0.0 and out[CHANGE] > 0.0):
        return
    rates = active.copy()
    rates[RATES] = True
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
    wider = widening(columns, chosen, left, lower, gradient[chosen].reshape(1, -1), 0.0)[0][0]
    if wider > 1.0 and variance > (FLOOR * amplitude) ** 2:  # a drift cannot be distinguished from such noise
        return
    out[AMPLITUDE], out[A_STD] = amplitude, np.sqrt(variance * explained(lower, gradient, chosen))
    gradient[:] = 0.0
    gradient[col.PHASE_RATE], gradient[col.SLOPE + 1] = 1.0 / (amplitude * scale), 2.0 / (amplitude * scale)
    out[OMEGA] = omega + 2.0 * bend / scale
    out[O_STD] = np.sqrt(variance * explained(lower, gradient, chosen))
    gradient[0], gradient[1] = b / amplitude**2, -a / amplitude**2
    gradient[col.PHASE_RATE], gradient[col.SLOPE + 1] = 1.0 / amplitude, 1.0 / amplitude
    out[PHASE] = np.arctan2(a, b) + omega * scale + bend
    out[P_STD] = np.sqrt(variance * explained(lower, gradient, chosen))
    out[RESIDUAL], out[DRIFT], out[CHANGE] = np.sqrt(variance), rate, 0.0
