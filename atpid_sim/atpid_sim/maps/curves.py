# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values of a map over the amplitude: monotone curves, none across a point that could not be computed."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from atpid_sim.system import Array


class MapCurve(NamedTuple):
    """Height, beam amplitude and efficiency over amplitudes from `first` to `last` [m], all of them computed."""

    first: float
    last: float
    values: Callable[[float], Array]


def unbroken(amplitudes: Array, values: Array) -> list[MapCurve]:
    """Return a curve for each stretch of amplitudes (n,) [m] whose values (n, 3) are numbers."""
    from scipy.interpolate import PchipInterpolator  # here, since a run without a map does not need it

    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    curves = []
    for places in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        x, y = amplitudes[places], values[places]
        if len(places) > 1:
            curves.append(MapCurve(float(x[0]), float(x[-1]), PchipInterpolator(x, y)))
        elif len(places) == 1:
            curves.append(MapCurve(float(x[0]), float(x[0]), partial(_constant, y[0])))
    return curves


def _constant(values: Array, _: float) -> Array:
    return values
