# SPDX-License-Identifier: Apache-2.0
"""The device's clock, given by its sample index, against the host's."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MINIMA = 120  # seconds of history


@dataclass(frozen=True)
class HardwareClock:
    """Time of a scan: start + index / rate, never a sum of periods.

    `start_ns` is the host's wall clock when index 0 was taken; `rate` [Hz] the device's actual rate.
    """

    start_ns: int
    rate: float

    def stamp_ns(self, index: int) -> int:
        """Return the time of scan `index` [ns since the epoch]."""
        return self.start_ns + round(index / self.rate * 1e9)


def earliest_line(places: NDArray[np.float64], times: NDArray[np.float64]) -> tuple[float, float]:
    """Return slope and offset of the line on which arrivals (n,) at rising places (n,) would be that nothing delays.

    A delay is never negative: of the lines below all arrivals it is the nearest, an edge of their lower convex hull
    (S. Moon, P. Skelly, D. Towsley, INFOCOM 1999).
    """
    hull = list[tuple[float, float]]()
    for place, time in zip(places.tolist(), times.tolist(), strict=True):
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], (place, time)):
            hull.pop()
        hull.append((place, time))
    middle = float(places.mean())
    edge = next((n for n in range(1, len(hull)) if hull[n][0] >= middle), len(hull) - 1)
    (first, begin), (last, end) = hull[edge - 1], hull[edge]
    slope = (end - begin) / (last - first) if last > first else math.nan
    return slope, begin - slope * first


def _turns_down(first: tuple[float, float], middle: tuple[float, float], last: tuple[float, float]) -> bool:
    run, rise = middle[0] - first[0], middle[1] - first[1]
    return run * (last[1] - first[1]) <= rise * (last[0] - first[0])


class DriftMeter:
    """Drift of the device's clock against the host's steady clock, from when blocks arrive.

    A block can arrive late but never early, so the least lateness in each second is kept and a line fitted
    to those: transport delays do not bias it.
    """

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque(maxlen=MINIMA)
        self._second: int | None = None
        self._best: tuple[float, float] | None = None
        self._origin: float | None = None
        self._first: float | None = None

    def add(self, device_s: float, host_s: float) -> None:
        """Take one block: time of its end by the device's clock and its arrival by the host's steady clock [s]."""
        if self._origin is None:
            self._origin = host_s - device_s
        late = host_s - device_s - self._origin
        second = int(device_s)
        if second != self._second and self._best is not None:
            self._minima.append(self._best)
            self._first = self._best[1] if self._first is None else self._first
            self._best = None
        self._second = second
        if self._best is None or late < self._best[1]:
            self._best = (device_s, late)

    @property
    def offset_s(self) -> float:
        """How far the host's clock has run ahead of the device's since the first second [s]; NaN: not known yet."""
        return self._minima[-1][1] - self._first if self._minima and self._first is not None else math.nan

    @property
    def drift_ppm(self) -> float:
        """How much slower the device's clock runs than the host's [ppm]; NaN in the first five seconds."""
        if len(self._minima) < 5:
            return math.nan
        time_s, late_s = np.array(self._minima).T
        return float(np.polyfit(time_s - time_s[0], late_s, 1)[0] * 1e6)
