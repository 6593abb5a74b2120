# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One time base: the clock of a device, followed on the host's steady clock, and stamps of steady times.

A message can arrive late but never early. So the least lateness of each second is kept, and under those of two minutes
lies the line whose sum of distances is least, the edge of their lower hull over their mean time (Moon, Skelly and
Towsley, INFOCOM 1999): delays, however large and rare, and stretches in which all are late do not bend it.
"""

import math
import os
import time
from collections import deque

import numpy as np
from numpy.typing import NDArray

#: Seconds of history: in more a crystal's drift bends, in fewer delays show.
_WINDOW = 120
#: Seconds before a drift is believed, and the drift [-] that crystals have without knowing better.
_FIRST, _USUAL = 5, 50e-6
#: Variable of the environment by which the processes of one stand share their time base.
TIME_BASE = "ATPID_TIME_BASE_NS"


def time_base_ns(*, anew: bool = False) -> int:
    """Return stamp minus steady clock [ns]: taken once, or `anew`, and inherited by the processes started later.

    A wall clock that is set or slewed meanwhile moves no stamp.
    """
    if anew or TIME_BASE not in os.environ:
        os.environ[TIME_BASE] = str(time.time_ns() - time.monotonic_ns())
    return int(os.environ[TIME_BASE])


def earliest_line(places: NDArray[np.float64], times: NDArray[np.float64]) -> tuple[float, float]:
    """Return slope and offset of the line on which arrivals (n,) at rising places (n,) would be that nothing delays.

    A delay is never negative: of the lines below all arrivals it is the nearest, an edge of their lower convex hull
    (S. Moon, P. Skelly, D. Towsley, INFOCOM 1999).
    """
    hull = list[tuple[float, float]]()
    for point in zip(places.tolist(), times.tolist(), strict=True):
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = float(places.mean())
    edge = next((n for n in range(1, len(hull)) if hull[n][0] >= middle), len(hull) - 1)
    (first, begin), (last, end) = hull[edge - 1], hull[edge]
    slope = (end - begin) / (last - first) if last > first else math.nan
    return slope, begin - slope * first


def _turns_down(first: tuple[float, float], middle: tuple[float, float], last: tuple[float, float]) -> bool:
    run, rise = middle[0] - first[0], middle[1] - first[1]
    return run * (last[1] - first[1]) <= rise * (last[0] - first[0])


class DeviceClock:
    """The steady times of a device's own, from when what it sends arrives; of bounded memory."""

    def __init__(self, began: float = math.nan) -> None:
        """Start; the device's time 0 was before the steady time `began` [s], where that is known."""
        self._least: deque[tuple[float, float]] = deque(maxlen=_WINDOW)  # device time and lateness, a second each
        self._second: int | None = None
        self._origin, self._offset = began, 0.0  # steady time of the device's 0: as first seen, and after it [s]
        self._drift, self._middle, self._spread = 0.0, 0.0, math.inf  # [-], mean time [s], its deviation [s]
        self._scatter = math.nan  # standard deviation of the line in its middle [s]

    def add(self, device_s: float, host_s: float) -> None:
        """Take a message: the device's time of it, and its arrival by the host's steady clock [s]."""
        if math.isnan(self._origin):
            self._origin = host_s - device_s
        late = host_s - device_s - self._origin
        if int(device_s) != self._second:
            self._second = int(device_s)
            self._fit()
            self._least.append((device_s, late))
        elif late < self._least[-1][1]:
            self._least[-1] = device_s, late
        self._offset = min(self._offset, late - self._drift * device_s)

    def _fit(self) -> None:
        if len(self._least) < _FIRST:
            return
        at, late = np.array(self._least).T
        self._middle, self._spread = float(at.mean()), float(at.std())
        slope, offset = earliest_line(at, late)
        # the mean of an exponential distribution by its median; as if all seconds counted alike, which is cautious
        self._scatter = float(np.median(late - offset - slope * at)) / math.log(2.0)
        self._scatter /= math.sqrt(len(at))
        self._drift = slope / (1.0 + (self._scatter / (self._spread * _USUAL)) ** 2)
        self._offset = float(np.min(late - self._drift * at))

    def steady(self, device_s: float) -> float:
        """Return the host's steady time of a time of the device [s]; NaN before the first message."""
        return self._origin + self._offset + device_s * (1.0 + self._drift)

    def device(self, steady_s: float) -> float:
        """Return the device's time of a steady one [s]."""
        return (steady_s - self._origin - self._offset) / (1.0 + self._drift)

    def stamp_ns(self, device_s: float) -> int:
        """Return the stamp of a time of the device [ns]."""
        return time_base_ns() + round(self.steady(device_s) * 1e9)

    def error(self, device_s: float) -> float:
        """Return the standard deviation of `steady` [s], but for the least delay, which nothing shows; NaN: unknown."""
        return self._scatter * math.hypot(1.0, (device_s - self._middle) / self._spread)

    @property
    def drift_ppm(self) -> float:
        """How much slower the device's clock runs than the host's [ppm]; NaN in the first five seconds."""
        return math.nan if math.isnan(self._scatter) else self._drift * 1e6

    @property
    def offset_s(self) -> float:
        """How far the host's clock has run ahead of the device's since the first message [s]; NaN: not known yet."""
        return math.nan if math.isnan(self._scatter) else self._drift * self._least[-1][0]
