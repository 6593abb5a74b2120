# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The quantities that are limited, from the samples of a channel and from the state of the motor."""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

#: Displacements change smoothly: a level counts as passed when so many samples in a row are beyond it, no lone spike.
SUSTAINED = 3
#: Contacts are counted over so long [s].
COUNTED = 1.0


def sustained(values: NDArray[np.float64], samples: int = SUSTAINED) -> float:
    """Return the largest magnitude that `samples` values (n,) in a row reach; NaN where there are not so many."""
    magnitude = np.abs(values)
    if len(magnitude) < samples:
        return math.nan
    windows = np.lib.stride_tricks.sliding_window_view(magnitude, samples)
    # a window with a sample that is no number is none
    lowest = windows.min(axis=1)
    return float(np.max(lowest, initial=-math.inf, where=~np.isnan(lowest))) if not np.isnan(lowest).all() else math.nan


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest magnitude of values (n,); NaN where there is none. An impact may last one sample."""
    magnitude = np.abs(values[~np.isnan(values)])
    return float(magnitude.max()) if len(magnitude) else math.nan


class ContactRate:
    """Contacts a second: pulses of the acceleration above a threshold, further apart than the dead time."""

    def __init__(self, threshold: float, dead_time: float) -> None:
        """Count none yet. threshold: of the magnitude [m/s^2]; dead_time: a pulse within it is the same contact [s]."""
        self._threshold, self._dead_time = threshold, dead_time
        self._contacts: deque[float] = deque()
        self._last_above = -math.inf

    def push(self, first_index: int, rate: float, acceleration: NDArray[np.float64]) -> float:
        """Take samples (n,) [m/s^2] from index `first_index` at `rate` [Hz]; return the contacts a second [1/s]."""
        for offset in np.flatnonzero(np.abs(acceleration) > self._threshold):
            time = (first_index + int(offset)) / rate
            if time - self._last_above > self._dead_time:
                self._contacts.append(time)
            self._last_above = time
        end = (first_index + len(acceleration)) / rate
        while self._contacts and self._contacts[0] < end - COUNTED:
            self._contacts.popleft()
        return len(self._contacts) / COUNTED


class OnTime:
    """How long the motor's current has been on without interruption [s]."""

    def __init__(self) -> None:
        self._since: float | None = None

    def push(self, on: bool, now: float) -> float:
        """Take whether it is on at the steady time `now` [s]; return for how long [s]."""
        if not on:
            self._since = None
            return 0.0
        self._since = now if self._since is None else self._since
        return now - self._since
