# SPDX-License-Identifier: Apache-2.0
"""The running twin: the beam simulated for the present excitation and height, compared with the measured one."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from typing import Protocol

from atpid_control.loop.computation import InlineExecutor
from atpid_control.loop.drift import DriftAlarm
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.simulate import simulate

#: Periods simulated and, of these, looked at.
PERIODS, LOOKED_AT = 80, 16
#: The last answer holds until amplitude, frequency or height has moved by more than this share [-].
SAME = 0.003
#: Settled periods in agreement after which a drift is reported again.
_AGREEING = 16


class SteadyTwin:
    """Simulates the steady state of a scene's beam and damper, again only when something has changed."""

    def __init__(self, scene: Scene) -> None:
        """Take the beam, damper and contact from `scene`."""
        self._scene = scene
        self._inputs = (math.nan, math.nan, math.nan)
        self._answer = math.nan
        # warm-up call: the kernels are loaded, or compiled, before the first settled period
        self._simulated(scene.grain.radius, scene.frequency_hz, 4.0 * scene.grain.radius)

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady half peak-to-peak [m]; NaN where the motion is irregular or cannot be simulated.

        `amplitude` [m] and `frequency` [Hz] of the excitation, `height` [m] of the ceiling. A new answer takes about
        10 ms.
        """
        inputs = (amplitude, frequency, height)
        if not all(abs(new - old) <= SAME * abs(old) for new, old in zip(inputs, self._inputs, strict=True)):
            self._inputs, self._answer = inputs, self._simulated(*inputs)
        return self._answer

    def _simulated(self, amplitude: float, frequency: float, height: float) -> float:
        if not all(map(math.isfinite, (amplitude, frequency, height))) or amplitude <= 0.0 or frequency <= 0.0:
            return math.nan
        duration = PERIODS / frequency
        scene = self._scene.with_(
            height=max(height, 2.0 * self._scene.grain.radius), amplitude=amplitude, frequency=frequency,
            duration=duration, steady_window=(duration - LOOKED_AT / frequency, duration),
        )  # fmt: skip
        try:
            result = simulate(scene, check=False)
        except NumericalFailure:
            return math.nan
        return math.nan if result.motion == "irregular" else result.amplitude


class Twin(Protocol):
    """Predicts the beam's amplitude."""

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady amplitude [m] under an excitation [m], [Hz] and ceiling [m]; NaN: unknown."""
        ...


class ModelCheck:
    """Compares the measured amplitude with the twin's, by the data's stamps."""

    def __init__(self, twin: Twin, alarm: DriftAlarm, executor: Executor | None = None) -> None:
        """Take the twin, and the alarm with the error the model is allowed.

        executor: where the twin is simulated, one call at a time; None: inline.
        """
        self._twin, self._executor = twin, executor or InlineExecutor()
        self.alarm = alarm
        self._next = -math.inf  # when the next period is over [s]
        self._pending: tuple[Future[float], float] | None = None  # the twin's amplitude to be, the measured one [m]
        self._agreed = 0
        self._reported = False
        self.expected = math.nan  # the twin's last amplitude [m]

    def restart(self) -> None:
        """Restart: another height or excitation. A reported drift is latched until there is agreement."""
        self.alarm.reset()
        self._agreed, self.expected, self._pending = 0, math.nan, None

    def check(self, time: float, excitation: tuple[float, float], height: float, beam: float) -> str:
        """Take a settled estimate at `time` [s]; return the text of a drift to report, else an empty one.

        excitation: amplitude [m] and frequency [Hz]; height: of the ceiling [m]; beam: its amplitude [m].
        """
        if self._pending is None and time >= self._next:
            self._next = time + 1.0 / excitation[1]
            self._pending = self._executor.submit(self._twin.expected, *excitation, height), beam
        if self._pending is None or not self._pending[0].done():
            return ""
        (future, measured), self._pending = self._pending, None
        return self._compared(future.result(), measured)

    def _compared(self, expected: float, measured: float) -> str:
        self.expected = expected
        state = self.alarm.push(expected, measured, True)
        self._agreed = self._agreed + 1 if state.level == 0.0 and expected > 0.0 else 0
        if self._agreed >= _AGREEING:
            self._reported = False
        if not state.alarm or self._reported:
            return ""
        self._reported = True
        side = "above" if state.deviation > 0.0 else "below"
        text = f"the beam's amplitude is {abs(state.deviation):.0%} {side} the model's ({measured:.4f} m against"
        return f"{text} {expected:.4f} m): check grain, beam and scene"
