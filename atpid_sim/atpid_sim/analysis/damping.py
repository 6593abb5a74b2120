# SPDX-License-Identifier: Apache-2.0
"""How much a motion is damped: decrements (Eq. 2.1), specific damping (Eq. 3.62)."""

from itertools import pairwise

import numpy as np

from atpid_sim.simulation.quantities import half_peak_to_peak, peaks
from atpid_sim.system import Array

#: Peaks below this share of the first are noise and rest, not decay, as in `simulation.quantities`.
_SMALLEST = 0.02


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


def specific_damping(displacement: Array) -> Array:
    """Return the specific damping coefficient (k,) [-] between successive upper peaks (Eq. 3.62).

    displacement (n,) [m] is that from rest; the coefficient is negative where the motion grows.
    """
    found = peaks(displacement)
    return np.asarray(1.0 - (found[1:] / found[:-1]) ** 2)
