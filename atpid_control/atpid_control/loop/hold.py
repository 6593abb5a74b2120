# SPDX-License-Identifier: Apache-2.0
"""When to select a new height, and when not to (docs/graph.md, "When the ceiling moves").

A ceiling too low only damps less; with one too high impacts lose synchronism, and the amplitude jumps ("rumble").
An estimate lags behind a ramp, being a mean over its window: on a rising ramp it is too low, which is the safe side, so
the ceiling may follow; on a falling one it is too high, so it must follow at once. A single jump is not a ramp.
"""

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from atpid_common.errors import InputError
from atpid_control.identification import Estimate, Quality

OFF_RESONANCE, NO_HEIGHT = "frequency off resonance", "no height for this amplitude"


class HoldError(InputError):
    """Settings of the hold or the step back that contradict themselves."""


@dataclass(frozen=True)
class HoldSettings:
    """Settings of the hold; none has a physical default, the parameter file has the values."""

    dead_band: float  # relative change of amplitude that moves nothing [-]
    sigmas: float  # a change must also exceed this many standard deviations [-]
    steady_count: int  # consecutive agreeing steady estimates that are acted on
    rising_count: int  # consecutive rising estimates, each above the dead band, that are a ramp to follow
    falling_count: int  # consecutive estimates below the dead band before it goes down
    frequency: float  # frequency the heights are made for [Hz]
    frequency_tolerance: float  # relative distance from it that is still on resonance [-]

    def __post_init__(self) -> None:
        """Raise HoldError for impossible settings."""
        limits = {
            "dead_band": (self.dead_band, 0.0 <= self.dead_band < 1.0, "at least 0 and below 1"),
            "sigmas": (self.sigmas, self.sigmas >= 0.0, "at least 0"),
            "steady_count": (self.steady_count, self.steady_count >= 1, "at least 1"),
            "rising_count": (self.rising_count, self.rising_count >= 2, "at least 2"),
            "falling_count": (self.falling_count, self.falling_count >= 1, "at least 1"),
            "frequency": (self.frequency, 0.0 < self.frequency < math.inf, "a positive number of hertz"),
            "frequency_tolerance": (self.frequency_tolerance, self.frequency_tolerance > 0.0, "above 0"),
        }
        for name, (given, fine, allowed) in limits.items():
            if not fine:
                raise HoldError(f"{name}: given {given}; allowed: {allowed}")


@dataclass(frozen=True)
class Verdict:
    """What to do: select for `amplitude` [m], or stay; `refused` marks an estimate that must not be acted on."""

    select: bool
    reason: str
    amplitude: float = math.nan
    amplitude_std: float = math.nan
    refused: bool = False


class Hold:
    """The dead band and hold: a state machine over estimates, without a clock."""

    def __init__(self, settings: HoldSettings) -> None:
        self._settings = settings
        self.acted_amplitude = math.nan  # amplitude the present height was selected for [m]; NaN: none yet
        self._failed = math.nan
        self._select_anew = False
        self._rising = _window(settings)
        self._falling = 0

    def configure(self, settings: HoldSettings, *, select_anew: bool = False) -> None:
        """Judge by other settings from the next estimate on.

        select_anew: the height for the present amplitude is to be selected again, the dead band notwithstanding.
        """
        self._settings, self._select_anew = settings, self._select_anew or select_anew
        self._rising, self._falling = _window(settings), 0

    def judge(self, estimate: Estimate) -> Verdict:
        """Return what to do about one more estimate. Answer a verdict to select with `acted` or `failed`."""
        trouble = self.trouble(estimate)
        if trouble:
            self._reset()
            # while the excitation changes its frequency has not settled either
            settling = estimate.quality == Quality.TRANSIENT and trouble == OFF_RESONANCE
            return Verdict(False, trouble, refused=estimate.quality != Quality.NONE and not settling)
        inside = self.inside(estimate, self.acted_amplitude)
        if inside and not self._select_anew:
            self._reset()
            return Verdict(False, "inside dead band")
        if self.inside(estimate, self._failed):
            return Verdict(False, NO_HEIGHT, refused=True)
        if estimate.amplitude < self.acted_amplitude and not inside:
            self._rising.clear()
            self._falling += 1
            if self._falling < self._settings.falling_count:
                return Verdict(False, "falling, not yet sure")
            return Verdict(True, "falling", estimate.amplitude, estimate.amplitude_std)
        return self._judge_rising(estimate)

    def acted(self, amplitude: float) -> None:
        """Record the amplitude [m] that was acted on."""
        self.acted_amplitude, self._failed, self._select_anew = amplitude, math.nan, False
        self._reset()

    def failed(self, amplitude: float) -> None:
        """Record that no height could be selected for `amplitude` [m]: it is not tried again inside the dead band."""
        self._failed, self._select_anew = amplitude, False
        self._reset()

    def agrees(self, amplitude: float, estimate: Estimate) -> bool:
        """Whether a height computed for `amplitude` [m] is right for an estimate that came meanwhile.

        It is where the excitation is still the same, and where it has moved on in the same direction: then that height
        lies between the present one and the next.
        """
        if self.inside(estimate, amplitude):
            return True
        start = 0.0 if math.isnan(self.acted_amplitude) else self.acted_amplitude
        return start < amplitude < estimate.amplitude or estimate.amplitude < amplitude < start

    def _judge_rising(self, estimate: Estimate) -> Verdict:
        self._falling = 0
        self._rising.append(estimate)
        if self._settled():
            return Verdict(True, "selected", estimate.amplitude, estimate.amplitude_std)
        if self._climbing():
            return Verdict(True, "rising", estimate.amplitude, estimate.amplitude_std)
        return Verdict(False, "waiting for a steady excitation")

    def _settled(self) -> bool:
        """Whether the last estimates are steady and agree with the newest."""
        last = list(self._rising)[-self._settings.steady_count :]
        enough = len(last) == self._settings.steady_count
        return enough and all(item.quality == Quality.STEADY and self.inside(item, last[-1].amplitude) for item in last)

    def _climbing(self) -> bool:
        """Whether the last estimates rise one after the other."""
        last = [item.amplitude for item in self._rising][-self._settings.rising_count :]
        enough = len(last) == self._settings.rising_count
        return enough and all(right > left for left, right in pairwise(last))

    def inside(self, estimate: Estimate, reference: float) -> bool:
        """Whether a change from `reference` [m] is inside the dead band or the noise; False where there is none."""
        if math.isnan(reference):
            return False
        noise = self._settings.sigmas * estimate.amplitude_std
        return abs(estimate.amplitude - reference) <= max(self._settings.dead_band * reference, noise)

    def trouble(self, estimate: Estimate) -> str:
        """Return why the estimate must not be acted on; empty if it may."""
        if estimate.quality == Quality.NONE:
            return "no estimate yet" if math.isnan(self.acted_amplitude) else "no estimate"
        if estimate.quality == Quality.POOR:
            return "poor estimate"
        if not all(map(math.isfinite, (estimate.amplitude, estimate.amplitude_std, estimate.frequency))):
            return "estimate is not a number"
        if estimate.amplitude <= 0.0:
            return "amplitude is not positive"
        off = abs(estimate.frequency / self._settings.frequency - 1.0)
        return "" if off <= self._settings.frequency_tolerance else OFF_RESONANCE

    def _reset(self) -> None:
        self._rising.clear()
        self._falling = 0


def _window(settings: HoldSettings) -> deque[Estimate]:
    """Return a buffer of as many estimates as a decision takes."""
    return deque(maxlen=max(settings.steady_count, settings.rising_count))
