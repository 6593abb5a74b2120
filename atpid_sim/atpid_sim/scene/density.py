# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Power spectral densities given by points: straight between them in logarithms of both, zero outside."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from atpid_sim.system import Array

#: One-sided, ((f [Hz], S [unit^2/Hz]), ...), f rising.
Density = tuple[tuple[float, float], ...]


def band_power(density: Density, edges: Sequence[float] | Array) -> Array:
    """Return the mean square (n,) [unit^2] between successive of the rising frequencies `edges` (n + 1,) [Hz].

    The exact integral of S = S1 (f / f1)^p over each segment.
    """
    f, s = (np.array(values) for values in zip(*density, strict=True))
    slopes = np.log(s[1:] / s[:-1]) / np.log(f[1:] / f[:-1]) + 1.0

    def below(segment: NDArray[np.intp], frequency: Array) -> Array:
        """Power of the segment below a frequency in it."""
        octaves, slope = np.log(frequency / f[segment]), slopes[segment]
        grown = np.where(np.abs(slope) < 1e-9, octaves, np.expm1(slope * octaves) / np.where(slope == 0.0, 1.0, slope))
        power: Array = s[segment] * f[segment] * grown
        return power

    segments = np.arange(len(slopes))
    before = np.concatenate([[0.0], np.cumsum(below(segments, f[1:]))])
    inside = np.clip(np.asarray(edges, dtype=float), f[0], f[-1])
    at = np.clip(np.searchsorted(f, inside, side="right") - 1, 0, len(slopes) - 1)
    return np.diff(before[at] + below(at, inside))
