# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Drift: the measured amplitude departs from the one simulated for the present excitation and height.

A two-sided CUSUM (Page, Biometrika 41, 1954): each settled period adds the logarithm of measured over predicted, less
what the model is allowed to be off; the alarm comes when the sum passes a threshold. False alarms and latency follow
from Siegmund's formula (Sequential Analysis, 1985).
"""

import math
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Protocol

from atpid_common.errors import InputError
from atpid_common.parameters import live, problem_of
from atpid_control.loop.protocol import InlineExecutor
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene

#: Mean overshoot of the sum over the threshold, in standard deviations (Siegmund).
OVERSHOOT = 1.166


class WatchError(InputError):
    """Settings of the monitoring, rumble or drift, that contradict themselves."""


@dataclass(frozen=True)
class _DriftState:
    """State of the alarm."""

    alarm: bool = False
    deviation: float = 0.0  # measured over predicted minus one, mean since the sum left zero [-]
    level: float = 0.0  # the larger sum, as a share of the threshold [-]


@dataclass(frozen=True)
class DriftSettings:
    """Settings of a `DriftAlarm`: parameters of the selector, after `drift_`."""

    tolerance: float = live(0.15, "relative error the model may have without a drift alarm", "-", 1e-3, 10.0)
    noise: float = live(0.02, "standard deviation of the beam's amplitude from period to period", "-", 1e-4, 1.0)
    #: At that edge, the worst case; an exact model gives hardly any.
    periods: float = live(
        10_000.0, "settled periods between false alarms of a model at the edge of its tolerance", "-", 1.0, 1e12
    )

    def __post_init__(self) -> None:
        if problem := problem_of(self):
            raise WatchError(problem)


class DriftAlarm:
    """Compares predicted with measured amplitudes, one pair a period."""

    def __init__(self, settings: DriftSettings) -> None:
        self._tolerance = math.log1p(settings.tolerance)
        # at the edge of the tolerance the sum has no drift, and its mean time to the threshold is the square of it
        self.threshold = settings.noise * max(math.sqrt(settings.periods) - OVERSHOOT, 1.0)
        self.reset()

    def reset(self) -> None:
        """Restart: another height or another excitation."""
        self._up = self._down = self._sum = 0.0
        self._count, self.state = 0, _DriftState()

    def push(self, predicted: float, measured: float) -> _DriftState:
        """Take a settled period's amplitudes [m]; unknown ones are ignored."""
        if not (predicted > 0.0 and measured > 0.0):
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
        self.state = _DriftState(level > 1.0, math.expm1(mean), level)
        return self.state


#: Periods simulated and, of these, looked at.
_PERIODS, _LOOKED_AT = 80, 16
#: The last answer holds until amplitude, frequency or height has moved by more than this share [-].
_SAME = 0.003
#: Settled periods in agreement after which a drift is reported again.
_AGREEING = 16


class SteadyTwin:
    """Simulates the steady state of a scene's beam and damper, again only when something has changed."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene.with_(initial=None)
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
        if not all(abs(new - old) <= _SAME * abs(old) for new, old in zip(inputs, self._inputs, strict=True)):
            self._inputs, self._answer = inputs, self._simulated(*inputs)
        return self._answer

    def _simulated(self, amplitude: float, frequency: float, height: float) -> float:
        from atpid_sim.simulation.simulate import simulate  # here, since what only judges amplitudes simulates nothing

        if not all(map(math.isfinite, (amplitude, frequency, height))) or amplitude <= 0.0 or frequency <= 0.0:
            return math.nan
        duration, height = _PERIODS / frequency, max(height, 2.0 * self._scene.grain.radius)
        window = duration - _LOOKED_AT / frequency, duration
        scene = self._scene.with_(
            height=height, amplitude=amplitude, frequency=frequency, duration=duration, steady_window=window
        )
        try:
            result = simulate(scene, check=False)
        except NumericalFailure:
            return math.nan
        return math.nan if result.motion == "irregular" else result.amplitude


class Twin(Protocol):
    """Predicts the beam's amplitude."""

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady amplitude [m] under an excitation [m], [Hz] and ceiling [m]; NaN: unknown."""


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
            self._next = round(time + 1.0 / excitation[1], 6)  # on the samples' own grid, whatever the last digits are
            self._pending = self._executor.submit(self._twin.expected, *excitation, height), beam
        if self._pending is None or not self._pending[0].done():
            return ""
        (future, measured), self._pending = self._pending, None
        return self._compared(future.result(), measured)

    def _compared(self, expected: float, measured: float) -> str:
        self.expected = expected
        state = self.alarm.push(expected, measured)
        self._agreed = self._agreed + 1 if state.level == 0.0 and expected > 0.0 else 0
        if self._agreed >= _AGREEING:
            self._reported = False
        if not state.alarm or self._reported:
            return ""
        self._reported = True
        side = "above" if state.deviation > 0.0 else "below"
        text = f"the beam's amplitude is {abs(state.deviation):.0%} {side} the model's ({measured:.4f} m against"
        return f"{text} {expected:.4f} m): check grain, beam and scene"
