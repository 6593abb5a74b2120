# SPDX-License-Identifier: Apache-2.0
"""Predicted against measured, in the loop: the twin is asked once a settled period, and drift is reported once."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from typing import Protocol

from atpid_control.computation import InlineExecutor
from atpid_control.watch.drift import DriftAlarm

#: Settled periods in agreement after which the next drift is news again.
_NEWS = 16


class Twin(Protocol):
    """Knows what the beam should do."""

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady amplitude [m] under an excitation [m], [Hz] and ceiling [m]; NaN: cannot say."""
        ...


class RealityCheck:
    """Compares the measured amplitude with the twin's, by the data's stamps."""

    def __init__(self, twin: Twin, alarm: DriftAlarm, executor: Executor | None = None) -> None:
        """Take the twin, and the alarm with what the model is allowed to be off.

        executor: where the twin is simulated, one call at a time; None: inline.
        """
        self._twin, self._executor = twin, executor or InlineExecutor()
        self.alarm = alarm
        self._next = -math.inf  # when the next period is over [s]
        self._asked: tuple[Future[float], float] | None = None  # the twin's amplitude to be, the measured one [m]
        self._agreed = 0
        self._reported = False
        self.expected = math.nan  # the twin's last amplitude [m]

    def restart(self) -> None:
        """Begin anew: another height or excitation. A reported drift is latched until there is agreement."""
        self.alarm.reset()
        self._agreed, self.expected, self._asked = 0, math.nan, None

    def check(self, time: float, excitation: tuple[float, float], height: float, swing: float) -> str:
        """Take a settled estimate at `time` [s]; return what to report where reality has left the model, else nothing.

        excitation: amplitude [m] and frequency [Hz]; height: of the ceiling [m]; swing: the beam's amplitude [m].
        """
        if self._asked is None and time >= self._next:
            self._next = time + 1.0 / excitation[1]
            self._asked = self._executor.submit(self._twin.expected, *excitation, height), swing
        if self._asked is None or not self._asked[0].done():
            return ""
        (future, measured), self._asked = self._asked, None
        return self._compared(future.result(), measured)

    def _compared(self, expected: float, measured: float) -> str:
        self.expected = expected
        state = self.alarm.push(expected, measured, True)
        self._agreed = self._agreed + 1 if state.level == 0.0 and expected > 0.0 else 0
        if self._agreed >= _NEWS:
            self._reported = False
        if not state.alarm or self._reported:
            return ""
        self._reported = True
        side = "more" if state.deviation > 0.0 else "less"
        text = f"the beam swings {abs(state.deviation):.0%} {side} than the model says ({measured:.4f} m against"
        return f"{text} {expected:.4f} m): check grain, beam and scene"
