# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rumble: impacts lose synchronism, and the beam's amplitude jumps from period to period.

A regular damper's amplitude is smooth however fast it changes: while the excitation ramps or the ceiling travels, the
logarithm of the amplitude over eight periods follows a parabola to within a few per cent. A motion that repeats every
second period adds an alternation, which is no rumble either. The residual of both is the scatter that is judged.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from atpid_control.identification.window import smoothed_half_range
from atpid_control.loop.drift import WatchError
from atpid_sim.system import Array

#: Periods looked at: the fewest that leave the parabola and the alternation as many degrees of freedom as they take.
PERIODS = 8
#: A window over which the amplitude grows or falls by more than this factor is not judged: the motion has just begun.
SWEEP = 2.5
#: A period counts where at least this share of its samples is valid.
VALID = 0.8


@dataclass(frozen=True)
class RumbleSettings:
    """Hysteresis of the alarm; the parameter file has the values."""

    onset: float  # scatter of the amplitude from which the response is irregular [-]
    calm: float  # scatter below which a period is calm again [-]
    calm_periods: int  # calm periods in a row that end the rumble
    least_amplitude: float  # a smaller response is not judged [m]

    def __post_init__(self) -> None:
        limits = {
            "onset": (self.onset, 0.0 < self.onset < 1.0, "between 0 and 1"),
            "calm": (self.calm, 0.0 < self.calm <= self.onset, "above 0 and at most onset"),
            "calm_periods": (self.calm_periods, self.calm_periods >= 1, "at least 1"),
            "least_amplitude": (self.least_amplitude, self.least_amplitude >= 0.0, "at least 0 m"),
        }
        for name, (given, fine, allowed) in limits.items():
            if not fine:
                raise WatchError(f"{name}: given {given:g}; allowed: {allowed}")


@dataclass(frozen=True)
class RumbleState:
    """State after the newest whole period."""

    rumbling: bool = False
    scatter: float = math.nan  # of the amplitude, relative, trend and alternation taken off [-]; NaN: not judged
    amplitude: float = math.nan  # half peak-to-peak in the newest whole period [m]
    periods: int = 0  # whole periods so far


class RumbleWatch:
    """Follows the measured beam period by period; periods are those of the excitation."""

    def __init__(self, settings: RumbleSettings) -> None:
        self.settings = settings  # may be replaced: the next period is judged by the new ones
        self._amplitudes: deque[float] = deque(maxlen=PERIODS)
        self._held = np.empty(0)
        self._first = 0  # index of the first sample held
        self._boundary = 0.0  # where the present period began, as an index
        self._calm = 0
        self.state = RumbleState()

    def push(self, first_index: int, rate: float, beam: Array, frequency: float) -> RumbleState:
        """Take a block of the beam's displacement (n,) [m], NaN where invalid, at `rate` [Hz].

        `frequency` [Hz] is the excitation's; without one (NaN) nothing is judged. Missing blocks show in
        `first_index` and break the series, as does a stream that starts anew.
        """
        if first_index != self._first + self._held.size or not frequency > 0.0:
            self._restart(first_index)
        self._held = np.concatenate((self._held, beam))
        if frequency > 0.0:
            self._take_periods(rate, frequency)
        else:
            self._restart(first_index + beam.size)
        return self.state

    def _restart(self, index: int) -> None:
        self._held, self._first, self._boundary = np.empty(0), index, float(index)
        self._amplitudes.clear()
        self._calm = 0
        self.state = RumbleState(periods=self.state.periods)

    def _take_periods(self, rate: float, frequency: float) -> None:
        length = round(rate / frequency, 6)  # where it is whole, the last digits of the frequency do not matter
        while self._boundary + length <= self._first + self._held.size:
            begin, end = round(self._boundary) - self._first, round(self._boundary + length) - self._first
            self._take(self._held[begin:end], 1.0 / rate, frequency)
            self._boundary += length
        used = round(self._boundary) - self._first
        self._held, self._first = self._held[used:], self._first + used

    def _take(self, period: Array, step: float, frequency: float) -> None:
        valid = np.count_nonzero(~np.isnan(period))
        amplitude = smoothed_half_range(period, step, frequency) if valid >= VALID * period.size else math.nan
        seen = self.state.periods + 1
        if not amplitude > self.settings.least_amplitude:
            self._amplitudes.clear()
            self.state = RumbleState(self.state.rumbling, amplitude=amplitude, periods=seen)
            return
        self._amplitudes.append(amplitude)
        scatter, _ = scatter_of(np.array(self._amplitudes))
        self.state = RumbleState(self._decide(scatter), scatter, amplitude, seen)

    def _decide(self, scatter: float) -> bool:
        if math.isnan(scatter):
            return self.state.rumbling
        if scatter >= self.settings.onset:
            self._calm = 0
            return True
        self._calm = self._calm + 1 if scatter < self.settings.calm else 0
        return self.state.rumbling and self._calm < self.settings.calm_periods


def scatter_of(amplitudes: Array) -> tuple[float, float]:
    """Return scatter and alternation [-] of successive periods' amplitudes (n,) [m]; NaN where it is not judged."""
    if amplitudes.size < PERIODS or amplitudes.max() > SWEEP * amplitudes.min():
        return math.nan, math.nan
    logarithms = np.log(amplitudes)
    coefficients = _SOLVE @ logarithms
    left = logarithms - _MODEL @ coefficients
    return float(np.sqrt(left @ left / (PERIODS - _MODEL.shape[1]))), float(abs(coefficients[-1]))


_X = np.linspace(-1.0, 1.0, PERIODS)
_MODEL = np.stack([np.ones(PERIODS), _X, _X * _X, (-1.0) ** np.arange(PERIODS)], axis=1)
_SOLVE = np.linalg.pinv(_MODEL)
