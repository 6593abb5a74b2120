# SPDX-License-Identifier: Apache-2.0
"""Drift: the measured amplitude departs from the predicted one. A two-sided CUSUM (Page, Biometrika 41, 1954).

Each settled period adds the logarithm of measured over predicted, less what the model is allowed to be off; the alarm
comes when the sum passes a threshold. False alarms and latency follow from Siegmund's formula (Sequential Analysis,
1985).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from atpid_control.loop.errors import WatchError

#: Mean overshoot of the sum over the threshold, in standard deviations (Siegmund).
OVERSHOOT = 1.166


@dataclass(frozen=True)
class DriftState:
    """State of the alarm."""

    alarm: bool = False
    deviation: float = 0.0  # measured over predicted minus one, mean since the sum left zero [-]
    level: float = 0.0  # the larger sum, as a share of the threshold [-]


@dataclass(frozen=True)
class DriftSettings:
    """Arguments of a `DriftAlarm`."""

    tolerance: float
    noise: float
    periods: float

    def __post_init__(self) -> None:
        """Raise WatchError for what is not positive."""
        self.alarm()

    def alarm(self) -> DriftAlarm:
        """Return an alarm in its initial state."""
        return DriftAlarm(self.tolerance, self.noise, self.periods)


class DriftAlarm:
    """Compares predicted with measured amplitudes, one pair a period."""

    def __init__(self, tolerance: float, noise: float, periods: float) -> None:
        """Allow the model to be off by `tolerance` [-]; measured amplitudes scatter by `noise` [-], one sigma.

        `periods` is the mean number of settled periods between false alarms while the model is off by all it may be:
        the worst case; an exact model gives hardly any. Raises WatchError for what is not positive.
        """
        for name, given in (("tolerance", tolerance), ("noise", noise), ("periods", periods)):
            if not given > 0.0:
                raise WatchError(f"{name}: given {given:g}; allowed: above 0")
        self._tolerance = math.log1p(tolerance)
        # at the edge of the tolerance the sum has no drift, and its mean time to the threshold is the square of it
        self.threshold = noise * max(math.sqrt(periods) - OVERSHOOT, 1.0)
        self._up = self._down = 0.0
        self._sum, self._count = 0.0, 0
        self.state = DriftState()

    def push(self, predicted: float, measured: float, settled: bool) -> DriftState:
        """Take one period's amplitudes [m]; periods that are not `settled`, or unknown, are ignored."""
        if not (settled and predicted > 0.0 and measured > 0.0):
            return self.state
        off = math.log(measured / predicted)
        self._up = max(0.0, self._up + off - self._tolerance)
        self._down = max(0.0, self._down - off - self._tolerance)
        level = max(self._up, self._down) / self.threshold
        if level == 0.0:
            self._sum, self._count = 0.0, 0
        else:
            self._sum, self._count = self._sum + off, self._count + 1
        mean = self._sum / self._count if self._count else 0.0
        self.state = DriftState(level > 1.0, math.expm1(mean), level)
        return self.state

    def reset(self) -> None:
        """Restart: another height or another excitation."""
        self._up = self._down = self._sum = 0.0
        self._count = 0
        self.state = DriftState()
