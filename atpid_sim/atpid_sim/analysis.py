# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Quantities of the thesis as pure functions over series, simulated or recorded.

How much a motion is damped: decrements (Eq. 2.1). The spectrum of a displacement (Figs 3.7 and 3.8). Simulation against
measurement: lag and offset by a stated rule, then the relative error (Eq. 3.46), which the thesis divides by the
measured X_Exp. Its list of symbols calls that an amplitude, and a displacement passes zero in every period: so
amplitudes of whole periods are compared, half the range in each, in which no offset is left and a lag of less than a
period changes little.
"""

from itertools import pairwise

import numpy as np

from atpid_sim.simulation.quantities import half_peak_to_peak, peaks
from atpid_sim.system import Array

#: Peaks below this share of the first are noise and rest, not decay, as in `simulation.quantities`.
_SMALLEST = 0.02
#: Zeros appended, in lengths of the signal: the spectrum is then read between its bins.
_PADDING = 8


def decrements(displacement: Array) -> Array:
    """Return the ratios of successive upper peaks (k,) [-] of a displacement from rest (n,) [m] (Eq. 2.1)."""
    found = peaks(displacement)
    found = found[found > _SMALLEST * found[0]] if len(found) else found
    return np.asarray(found[:-1] / found[1:])


def amplitudes_per_period(displacement: Array, samples: float) -> Array:
    """Return half the range (k,) [m] of a displacement (n,) [m] in each whole period of `samples` samples."""
    count = int(len(displacement) / samples)
    edges = np.rint(samples * np.arange(count + 1)).astype(int)
    pieces = [displacement[begin:end] for begin, end in pairwise(edges)]
    return np.array([half_peak_to_peak(piece) for piece in pieces])


def amplitude_spectrum(displacement: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies (m,) [Hz] and amplitudes (m,) [m] of a displacement (n,) [m] sampled at `rate` [Hz].

    The mean is removed; the signal is neither windowed nor scaled beyond 2 / n, so that a tone over whole periods has
    its own amplitude.
    """
    count = len(displacement)
    spectrum = np.abs(np.fft.rfft(displacement - displacement.mean(), _PADDING * count))
    frequencies = np.fft.rfftfreq(_PADDING * count, 1.0 / rate)
    return np.asarray(frequencies, dtype=float), 2.0 * spectrum / count


def lag_of(measured: Array, simulated: Array, most: int) -> int:
    """Return by how many samples a measurement (n,) is later than its simulation (n,): the best correlation.

    Looked for from -most to most samples; both are taken without their means.
    """
    one, other = measured - measured.mean(), simulated - simulated.mean()
    size = len(one)

    def correlation(lag: int) -> float:
        return float(one[max(lag, 0) : size + min(lag, 0)] @ other[max(-lag, 0) : size - max(lag, 0)])

    return max(range(-most, most + 1), key=correlation)


def aligned(measured: Array, simulated: Array, lag: int) -> tuple[Array, Array]:
    """Return both series (k,) [m] over their common time, the lag [samples] and the offset removed."""
    size = len(measured)
    one, other = measured[max(lag, 0) : size + min(lag, 0)], simulated[max(-lag, 0) : size - max(lag, 0)]
    return one - one.mean() + other.mean(), other


def relative_rmse(experiment: Array, simulation: Array) -> float:
    """Return the root mean square of (X_Exp - X_Sim) / X_Exp [-] over the amplitudes of whole periods (Eq. 3.46).

    experiment, simulation: (k,) [m], as `amplitudes_per_period` gives them.
    """
    return float(np.sqrt(np.mean(((experiment - simulation) / experiment) ** 2)))
