# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values of a map over the amplitude: monotone curves, none across a point that could not be computed.

The curve is here because the import of scipy.interpolate would take a tenth of the time of a bench; a test holds it to
`scipy.interpolate.PchipInterpolator`.
"""

from collections.abc import Callable
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
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    curves = []
    for places in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        x, y = amplitudes[places], values[places]
        if len(places):
            curve = monotone(x, y) if len(places) > 1 else lambda _, only=y[0]: only
            curves.append(MapCurve(float(x[0]), float(x[-1]), curve))
    return curves


def monotone(x: Array, y: Array) -> Callable[[float], Array]:
    """Return the cubic curve through (n, ...) values y at rising x (n,), n > 1, monotone wherever they are.

    Slopes by F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300. The curve is for x inside.
    """
    widths = np.diff(x).reshape(-1, *[1] * (np.ndim(y) - 1))
    rises = np.diff(y, axis=0) / widths
    slopes = np.empty_like(y)
    slopes[[0, -1]] = rises[[0, -1]]
    if len(x) > 2:
        one, two = 2.0 * widths[1:] + widths[:-1], widths[1:] + 2.0 * widths[:-1]
        same = rises[:-1] * rises[1:] > 0.0
        before, after = np.where(same, rises[:-1], 1.0), np.where(same, rises[1:], 1.0)
        slopes[1:-1] = np.where(same, (one + two) / (one / before + two / after), 0.0)
        slopes[0] = _end(widths[0], widths[1], rises[0], rises[1])
        slopes[-1] = _end(widths[-1], widths[-2], rises[-1], rises[-2])

    def at(place: float) -> Array:
        k = int(np.clip(np.searchsorted(x, place, side="right") - 1, 0, len(x) - 2))
        s = (place - x[k]) / (x[k + 1] - x[k])
        tangents = (1.0 - s) * slopes[k] - s * slopes[k + 1]
        straight = (1.0 - s) * y[k] + s * y[k + 1]
        bend = (1.0 - 2.0 * s) * (y[k] - y[k + 1])
        return np.asarray(straight + s * (1.0 - s) * (bend + tangents * (x[k + 1] - x[k])))

    return at


def _end(width: Array, next_width: Array, rise: Array, next_rise: Array) -> Array:
    """Return the slopes at an end: of the parabola through three points, made monotone."""
    slope = ((2.0 * width + next_width) * rise - width * next_rise) / (width + next_width)
    slope = np.where(slope * rise > 0.0, slope, 0.0)
    return np.where((rise * next_rise <= 0.0) & (np.abs(slope) > 3.0 * np.abs(rise)), 3.0 * rise, slope)
