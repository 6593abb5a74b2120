# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""When to select a new height, when not to, and the step back from a rumble (docs/graph.md, "When the ceiling moves").

A ceiling too low only damps less; with one too high impacts lose synchronism, and the amplitude jumps ("rumble").
An estimate lags behind a ramp, being a mean over its window: on a rising ramp it is too low, which is the safe side, so
the ceiling may follow; on a falling one it is too high, so it must follow at once. A single jump is not a ramp.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from atpid_common.errors import InputError
from atpid_common.parameters import live, problem_of
from atpid_common.vocabulary import EventKind
from atpid_control.identification import Estimate, Quality

OFF_RESONANCE, NO_HEIGHT = "frequency off resonance", "no height for this amplitude"
#: Estimates without a decision after which that is reported, 2 s in blocks of 50 ms, and the reason.
UNSETTLED_COUNT = 40
_WAITING = "waiting for a steady excitation"
UNSETTLED = f"the excitation has not settled for {UNSETTLED_COUNT} estimates, or changes faster than is followed"

#: Relative differences up to this are the arithmetic's, which another processor rounds otherwise: they decide nothing.
_ROUNDING = 1e-9
#: How far a frequency may have moved on since its height was asked for [-]: a drift of 1 % a second, and a slow method.
_MOVED_ON = 0.01


class HoldError(InputError):
    """Settings of the hold or the step back that contradict themselves."""


_STILL = (
    "at which heights of a method for that one still hold; the standard bench's half-power points lie 0.022 beside it"
)
_ANYWHERE = "of a method that selects at any frequency: 0.01 is up to 0.05 of the height"


@dataclass(frozen=True, kw_only=True)
class HoldSettings:
    """Settings of the hold: parameters of the selector, and what its method's heights are for."""

    dead_band: float = live(
        0.01, "relative change of amplitude that moves nothing: below 0.01 less than can be positioned", "-", 0.0, 0.9
    )
    sigmas: float = live(4.0, "a change must also exceed this many standard deviations", "-", 0.0, 100.0)
    steady_count: int = live(4, "consecutive agreeing steady estimates that are acted on", "", 1, 1000)
    rising_count: int = live(4, "consecutive rising estimates that are a ramp to follow", "", 2, 1000)
    falling_count: int = live(2, "consecutive lower estimates before the ceiling goes down", "", 1, 1000)
    frequency_tolerance: float = live(0.03, f"relative distance from the scene's frequency {_STILL}", "-", 1e-6, 1.0)
    frequency_band: float = live(0.0025, f"relative change of frequency that moves nothing, {_ANYWHERE}", "-", 0.0, 0.9)
    frequency: float  # frequency the heights are made for [Hz]
    reach: tuple[float, float] | None = None  # of a method that selects at any frequency between these [Hz]

    def __post_init__(self) -> None:
        if problem := problem_of(self):
            raise HoldError(problem)
        if not 0.0 < self.frequency < math.inf:
            raise HoldError(f"frequency: given {self.frequency}; allowed: a positive number of hertz")


@dataclass(frozen=True)
class HoldDecision:
    """What to do: select for `amplitude` [m] and `frequency` [Hz], or stay; `refused`: it must not be acted on."""

    select: bool
    reason: str
    amplitude: float = math.nan
    refused: bool = False
    frequency: float = math.nan

    @staticmethod
    def to_select(reason: str, estimate: Estimate) -> HoldDecision:
        """Return the verdict to select for an estimate."""
        return HoldDecision(True, reason, estimate.amplitude, frequency=estimate.frequency)


class Hold:
    """The dead band and hold: a state machine over estimates, without a clock."""

    def __init__(self, settings: HoldSettings) -> None:
        self._settings = settings
        self.acted_amplitude = math.nan  # amplitude the present height was selected for [m]; NaN: none yet
        self._acted_frequency = math.nan  # and the frequency [Hz]
        self._failed = (math.nan, math.nan)  # amplitude [m] and frequency [Hz] for which there is no height
        self._select_anew = False
        self._rising = _window(settings)
        self._falling = self._undecided = 0

    def configure(self, settings: HoldSettings, *, select_anew: bool = False) -> None:
        """Judge by other settings from the next estimate on.

        select_anew: the height for the present amplitude is to be selected again, the dead band notwithstanding.
        """
        self._settings, self._select_anew = settings, self._select_anew or select_anew
        self._rising, self._falling = _window(settings), 0

    def judge(self, estimate: Estimate) -> HoldDecision:
        """Return what to do about one more estimate. Answer a verdict to select with `acted` or `failed`."""
        verdict = self._judged(estimate)
        undecided = verdict.reason in (_WAITING, OFF_RESONANCE) and not verdict.refused
        self._undecided = self._undecided + 1 if undecided else 0
        return HoldDecision(False, UNSETTLED, refused=True) if self._undecided >= UNSETTLED_COUNT else verdict

    def _judged(self, estimate: Estimate) -> HoldDecision:
        reason = self.reason_to_reject(estimate)
        if reason:
            self._reset()
            # while the excitation changes its frequency has not settled either
            settling = estimate.quality == Quality.TRANSIENT and reason == OFF_RESONANCE
            return HoldDecision(False, reason, refused=estimate.quality != Quality.NONE and not settling)
        same_amplitude = self.inside(estimate, self.acted_amplitude)
        if same_amplitude and self._same_frequency(estimate, self._acted_frequency) and not self._select_anew:
            self._reset()
            return HoldDecision(False, "inside dead band")
        if self.inside(estimate, *self._failed):
            return HoldDecision(False, NO_HEIGHT, refused=True)
        if estimate.amplitude < self.acted_amplitude and not same_amplitude:
            self._rising.clear()
            self._falling += 1
            if self._falling < self._settings.falling_count:
                return HoldDecision(False, "falling, not yet sure")
            return HoldDecision.to_select("falling", estimate)
        return self._judge_rising(estimate, same_amplitude)

    def acted(self, amplitude: float, frequency: float = math.nan) -> None:
        """Record the amplitude [m] and the frequency [Hz] that were acted on."""
        self.acted_amplitude, self._acted_frequency = amplitude, frequency
        self._failed, self._select_anew = (math.nan, math.nan), False
        self._reset()

    def failed(self, amplitude: float, frequency: float = math.nan) -> None:
        """Record that there is no height for `amplitude` [m] at `frequency` [Hz]: not tried again in the dead band."""
        self._failed, self._select_anew = (amplitude, frequency), False
        self._reset()

    def agrees(self, amplitude: float, estimate: Estimate, frequency: float = math.nan) -> bool:
        """Whether a height computed for `amplitude` [m] and `frequency` [Hz] is right for an estimate since.

        True if the excitation is unchanged, or has moved further in the same direction: then that height lies between
        the present one and the next. A frequency may have moved on by a hundredth: one that drifts is never the same
        when its height comes, and the next height is on its way.
        """
        if self._settings.reach is not None and abs(estimate.frequency / frequency - 1.0) > _MOVED_ON:
            return False
        if self.inside(estimate, amplitude):
            return True
        start = 0.0 if math.isnan(self.acted_amplitude) else self.acted_amplitude
        return start < amplitude < estimate.amplitude or estimate.amplitude < amplitude < start

    def _judge_rising(self, estimate: Estimate, same_amplitude: bool) -> HoldDecision:
        self._falling = 0
        self._rising.append(estimate)
        if self._settled():
            another = same_amplitude and not self._same_frequency(estimate, self._acted_frequency)
            return HoldDecision.to_select("selected for another frequency" if another else "selected", estimate)
        if self._climbing() and not same_amplitude:
            return HoldDecision.to_select("rising", estimate)
        return HoldDecision(False, _WAITING)

    def _settled(self) -> bool:
        """Whether the last estimates are steady and agree with the newest."""
        last = list(self._rising)[-self._settings.steady_count :]
        enough = len(last) == self._settings.steady_count
        newest = (last[-1].amplitude, last[-1].frequency)
        return enough and all(item.quality == Quality.STEADY and self.inside(item, *newest) for item in last)

    def _climbing(self) -> bool:
        """Whether the last estimates rise one after the other."""
        last = [item.amplitude for item in self._rising][-self._settings.rising_count :]
        enough = len(last) == self._settings.rising_count
        return enough and all(right > (1.0 + _ROUNDING) * left for left, right in pairwise(last))

    def inside(self, estimate: Estimate, reference: float, frequency: float = math.nan) -> bool:
        """Whether a change from `reference` [m] is inside the dead band or the noise; False where there is none.

        frequency: compared as well [Hz], by a method that selects at any frequency; NaN: it is not.
        """
        if math.isnan(reference):
            return False
        noise = self._settings.sigmas * estimate.amplitude_std
        same = abs(estimate.amplitude - reference) <= max((self._settings.dead_band + _ROUNDING) * reference, noise)
        return same and self._same_frequency(estimate, frequency)

    def _same_frequency(self, estimate: Estimate, reference: float) -> bool:
        """Whether a change from a frequency [Hz] is inside its band or the noise, or does not count."""
        if self._settings.reach is None or math.isnan(reference):
            return True
        noise = self._settings.sigmas * estimate.frequency_std if math.isfinite(estimate.frequency_std) else 0.0
        band = (self._settings.frequency_band + _ROUNDING) * reference
        return abs(estimate.frequency - reference) <= max(band, noise)

    def reason_to_reject(self, estimate: Estimate) -> str:
        """Return why the estimate must not be acted on; empty if it may."""
        if estimate.quality == Quality.NONE:
            return "no estimate yet" if math.isnan(self.acted_amplitude) else "no estimate"
        if estimate.quality == Quality.POOR:
            return "poor estimate"
        if not all(map(math.isfinite, (estimate.amplitude, estimate.amplitude_std, estimate.frequency))):
            return "estimate is not a number"
        if estimate.amplitude <= 0.0:
            return "amplitude is not positive"
        return "" if self._reaches(estimate.frequency) else OFF_RESONANCE

    def _reaches(self, frequency: float) -> bool:
        """Whether there are heights for a frequency [Hz]."""
        if self._settings.reach is not None:
            low, high = self._settings.reach
            return (1.0 - _ROUNDING) * low <= frequency <= (1.0 + _ROUNDING) * high
        return abs(frequency / self._settings.frequency - 1.0) <= self._settings.frequency_tolerance + _ROUNDING

    def _reset(self) -> None:
        self._rising.clear()
        self._falling = 0


def _window(settings: HoldSettings) -> deque[Estimate]:
    """Return a buffer of as many estimates as a decision takes."""
    return deque(maxlen=max(settings.steady_count, settings.rising_count))


#: An amplitude below this share of the one before the span, so many values, is decaying.
DECAY, DECAY_SPAN = 0.97, 8
#: So many bursts of rumble with the ceiling standing count as one rumble, however short each is.
_BURSTS = 2


@dataclass(frozen=True)
class StepBack:
    """Settings of the step back, parameters of the selector."""

    step_back: float = live(0.06, "share of the clearance given up when the motion is irregular", "-", 1e-3, 0.9)
    settle_count: int = live(
        24, "estimates at rest before irregular motion counts: the closed beam's decay time", "", 0, 10_000
    )
    rumble_count: int = live(
        6, "consecutive irregular estimates after that, before the ceiling steps back", "", 1, 10_000
    )
    step_back_excess: float = live(
        0.15, "amplitude of the beam above the predicted that is more than inaccuracy", "-", 0.0, 10.0
    )
    step_back_memory: float = live(
        0.05, "change of the excitation's amplitude over which a step back applies", "-", 0.0, 10.0
    )

    def __post_init__(self) -> None:
        if problem := problem_of(self):
            raise HoldError(problem)


class StepBackMonitor:
    """Decides when one ceiling steps back and by how much, and limits later selections."""

    def __init__(self, settings: StepBack, lowest: float) -> None:
        """Take the settings and the lowest height of the ceiling [m]."""
        self.settings = settings  # may be replaced: they hold from the next estimate on
        self._lowest = lowest
        self._rumbling = False
        self._rumbled = 0  # estimates in rumble that the height causes
        self._stood = 0  # consecutive estimates with the ceiling where it was sent
        self._bursts = 0  # rumbles that began with the ceiling standing and the beam too large
        self._limit = math.nan  # amplitude of the beam from which it is too large [m], NaN: any
        self._amplitudes: deque[float] = deque(maxlen=DECAY_SPAN)  # the beam's latest amplitudes [m]
        self._stepped_at = math.nan  # excitation amplitude of the last step back [m]
        self._kept = 1.0  # share of the selected clearance that was left then [-]

    @property
    def settled(self) -> bool:
        """Whether the ceiling has stood for the settling time and the beam is regular."""
        return self._stood > self.settings.settle_count and not self._rumbling

    def on_event(self, kind: str) -> None:
        """Take an event: `rumble`, or `calm` when that has ended."""
        if kind not in (EventKind.RUMBLE, EventKind.CALM):
            return
        self._rumbling = kind == EventKind.RUMBLE
        if self._rumbling and self._stood > self.settings.settle_count and self._amplitudes:
            # a burst is detected near its end: its size shows in the amplitudes before
            self._bursts += not max(self._amplitudes) <= self._limit

    def watch(self, amplitude: float, expected: float, standing: bool) -> bool:
        """Take one more estimate; return whether it is time for a step.

        amplitude, expected: of the beam, measured and predicted [m], NaN: unknown; standing: the ceiling is where it
        was sent. The height is the cause where the ceiling stands and the beam rumbles, too large, without decaying:
        while the ceiling moves, and while a larger motion decays, the response is irregular at any height.
        """
        self._amplitudes.append(amplitude)
        decaying = len(self._amplitudes) == DECAY_SPAN and amplitude < DECAY * self._amplitudes[0]
        self._limit = (1.0 + self.settings.step_back_excess) * expected
        self._stood = self._stood + 1 if standing else 0
        caused = self._rumbling and self._stood > self.settings.settle_count and not amplitude <= self._limit
        # a rumble swells and fades: while it fades the count is held
        self._rumbled = (self._rumbled + (not decaying)) if caused else 0
        return self._rumbled >= self.settings.rumble_count or self._bursts >= _BURSTS

    def interrupt(self) -> None:
        """Restart the counts: another height was selected."""
        self._rumbled = self._stood = self._bursts = 0

    def lower(self, height: float, amplitude: float) -> float:
        """Return the height [m] a step below `height`, at least the lowest; it applies to `amplitude` [m]."""
        if not self._applies(amplitude):
            self._kept = 1.0
        self._stepped_at = amplitude
        self._kept *= 1.0 - self.settings.step_back
        self.interrupt()
        return height - self.settings.step_back * max(0.0, height - self._lowest)

    def allowed(self, height: float, amplitude: float) -> float:
        """Return the height [m] allowed where `height` is selected for `amplitude` [m]: lower after a step back."""
        if not self._applies(amplitude):
            self._stepped_at, self._kept = math.nan, 1.0
        return height if self._kept == 1.0 else self._lowest + self._kept * max(0.0, height - self._lowest)

    def _applies(self, amplitude: float) -> bool:
        return abs(amplitude - self._stepped_at) <= self.settings.step_back_memory * self._stepped_at
