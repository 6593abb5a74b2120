# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The columns of the fit's linear model: the tone, what may lie on top of it, and what makes it unsteady.

The four of IEEE 1057 always take part. The others come in groups, and only where they are significant.
"""

from itertools import pairwise

import numpy as np

from atpid_control.identification.linear import compiled
from atpid_sim.system import Array

COSINE, SINE, ONE, PHASE_RATE = 0, 1, 2, 3
BASE = 4
DRIFT = 4
HARMONICS = 5  # cosine and sine of the second to the fifth
HIGHEST_HARMONIC = 5
HUM = 13
SLOPE = 15  # amplitude and frequency changing at a constant rate
RECENT = 17  # another amplitude and phase in the newest quarter, half and whole period
_OLD = 23  # and in the oldest quarter and half
CURVE = 27  # of the offset, where it drifts
COUNT = 28
#: Groups of columns, (first, one past the last): the first three lie on a steady tone, the others make it unsteady.
_FIRST = (DRIFT, HARMONICS, HUM, SLOPE, RECENT, RECENT + 2, RECENT + 4, _OLD, _OLD + 2, CURVE, COUNT)
GROUPS = tuple(pairwise(_FIRST))
STEADY_GROUPS = 3
FIRST_RECENT = 4
_RECENT_PERIODS = (0.25, 0.5, 1.0)
_OLD_PERIODS = (0.25, 0.5)
#: Groups that only a window longer than one period can distinguish from the others.
LONG_GROUPS = (6, 7, 8)
#: The group that joins with the drift, and never by itself.
CURVED = 9


@compiled
def write_tone(columns: Array, tau: Array, omega: float, cosine: float, sine: float, scale: float) -> None:
    """Write columns that depend on the frequency, for the tone cosine cos(omega tau) + sine sin(omega tau), scale [s].

    The phase's rate is in units of 1/scale times the amplitude, so that all columns are of order one.
    """
    norm = 1.0 / max(np.hypot(cosine, sine), 1e-300)
    for i in range(tau.size):
        c, s = np.cos(omega * tau[i]), np.sin(omega * tau[i])
        columns[COSINE, i], columns[SINE, i] = c, s
        columns[PHASE_RATE, i] = (tau[i] / scale) * (sine * c - cosine * s) * norm


@compiled
def write_harmonics(columns: Array) -> None:
    """Write the harmonics of the tone already written, each from the one before."""
    c, s = columns[COSINE], columns[SINE]
    for i in range(c.size):
        a, b = c[i], s[i]
        for k in range(HIGHEST_HARMONIC - 1):
            a, b = a * c[i] - b * s[i], b * c[i] + a * s[i]
            columns[HARMONICS + 2 * k, i] = a
            columns[HARMONICS + 2 * k + 1, i] = b


@compiled
def write_constant(columns: Array, tau: Array, hum: float, scale: float) -> None:
    """Write the columns no frequency of ours changes: offset, drift, hum at angular frequency `hum` [rad/s]."""
    for i in range(tau.size):
        columns[ONE, i] = 1.0
        columns[DRIFT, i] = tau[i] / scale
        columns[CURVE, i] = columns[DRIFT, i] ** 2 - 1.0 / 3.0
        columns[HUM, i] = np.cos(hum * tau[i])
        columns[HUM + 1, i] = np.sin(hum * tau[i])


@compiled
def write_changes(
    columns: Array, tau: Array, end: float, period: float, cosine: float, sine: float, scale: float
) -> None:
    """Write what a changing tone would add; `end` is the window's end [s] on the axis of `tau`."""
    norm = 1.0 / max(np.hypot(cosine, sine), 1e-300)
    for i in range(tau.size):
        c, s = columns[COSINE, i], columns[SINE, i]
        reduced = tau[i] / scale
        columns[SLOPE, i] = reduced * (cosine * c + sine * s) * norm
        columns[SLOPE + 1, i] = reduced * columns[PHASE_RATE, i]
        for k in range(len(_RECENT_PERIODS)):
            inside = tau[i] > end - _RECENT_PERIODS[k] * period
            columns[RECENT + 2 * k, i] = c if inside else 0.0
            columns[RECENT + 2 * k + 1, i] = s if inside else 0.0
        for k in range(len(_OLD_PERIODS)):
            inside = tau[i] < tau[0] + _OLD_PERIODS[k] * period
            columns[_OLD + 2 * k, i] = c if inside else 0.0
            columns[_OLD + 2 * k + 1, i] = s if inside else 0.0
