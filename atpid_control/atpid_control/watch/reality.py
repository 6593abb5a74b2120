# SPDX-License-Identifier: Apache-2.0
"""Predicted against measured, in the loop: the twin is asked once a settled period, and drift is said once."""

from __future__ import annotations

import math
from typing import Protocol

from atpid_control.watch.drift import DriftAlarm

#: Settled periods in agreement after which the next drift is news again.
_NEWS = 16


class Twin(Protocol):
    """Knows what the beam should do."""

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady amplitude [m] under an excitation [m], [Hz] and ceiling [m]; NaN: cannot say."""
        ...


class RealityCheck:
    """Holds the measured amplitude against the twin's, by the data's stamps."""

    def __init__(self, twin: Twin, alarm: DriftAlarm) -> None:
        """Take the twin, and the alarm with what the model is allowed to be off."""
        self._twin, self._alarm = twin, alarm
        self._next = -math.inf  # when the next period is over [s]
        self._agreed = 0
        self._said = False
        self.expected = math.nan  # what the twin said last [m]

    def restart(self) -> None:
        """Begin anew: another height or excitation. A drift said stays said until there is agreement."""
        self._alarm.reset()
        self._agreed, self.expected = 0, math.nan

    def check(self, time: float, excitation: tuple[float, float], height: float, swing: float) -> str:
        """Take a settled estimate at `time` [s]; return what to say where reality has left the model, else nothing.

        excitation: amplitude [m] and frequency [Hz]; height: of the ceiling [m]; swing: the beam's amplitude [m].
        """
        if time < self._next:
            return ""
        self._next = time + 1.0 / excitation[1]
        self.expected = self._twin.expected(*excitation, height)
        state = self._alarm.push(self.expected, swing, True)
        self._agreed = self._agreed + 1 if state.level == 0.0 and self.expected > 0.0 else 0
        if self._agreed >= _NEWS:
            self._said = False
        if not state.alarm or self._said:
            return ""
        self._said = True
        side = "more" if state.deviation > 0.0 else "less"
        text = f"the beam swings {abs(state.deviation):.0%} {side} than the model says ({swing:.4f} m against"
        return f"{text} {self.expected:.4f} m): check grain, beam and scene"
