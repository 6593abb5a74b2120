# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Finds the tone in a buffer: seed, window of whole periods, fit, and its quality."""

import math
from dataclasses import dataclass, replace

import numpy as np

from atpid_common.vocabulary import Quality
from atpid_control.identification.choice import PENALTY
from atpid_control.identification.estimate import Settings
from atpid_control.identification.sine_fit import SineFit, fit_sine
from atpid_control.identification.window import SampleBuffer, seed_frequency, without_clipping

TAU = 2.0 * math.pi
#: A tone must stand out of the residual by so many standard deviations: noise alone reaches it once in 10^10 fits.
SIGNIFICANT = 7.0
#: Windows are cut by the seed's frequency, so one period may turn out this much shorter.
ONE_PERIOD = 0.97
#: A window cut by a frequency further off than this is cut again.
RECUT = 0.05
#: A seed this near to the last frequency is the same tone.
NEAR = 0.15
#: One period may be called steady while two are not, if no larger change of amplitude can hide in its noise [-].
HIDDEN_CHANGE = 0.02
#: With more than this share of the samples lost a change cannot be distinguished from the gaps.
CHANGE_LOST = 0.25
#: Over the residual of the newest period alone: what leaves less in the whole window is there, and no change.
ALL_THERE_IS = 1.2


@dataclass(frozen=True)
class Tone:
    """A fitted tone, its window and what was missing from it."""

    fit: SineFit
    window: float  # [s]
    lost: int
    quality: Quality

    @property
    def frequency(self) -> float:
        """Frequency [Hz]."""
        return self.fit.omega / TAU


class ToneFinder:
    """Follows the tone of one channel of a buffer."""

    def __init__(self, settings: Settings, shorten: bool = True) -> None:
        """Start without a frequency; with `shorten` a transient is looked at in one period, too."""
        self.settings, self._shorten = settings, shorten
        self.frequency = math.nan  # of the last tone found [Hz]
        self.acceleration = False  # whether the channel is one [m/s^2]

    def find(self, buffer: SampleBuffer, channel: int) -> Tone | None:
        """Return the tone in the newest samples; None where there is none, or less than a period of it."""
        known = not math.isnan(self.frequency)
        periods = self.settings.window_periods
        tone = self._search(buffer, channel, self._count(buffer, periods, self.frequency)) if known else None
        if tone is None or tone.quality == Quality.POOR:
            wider = self._search(buffer, channel, buffer.size)
            tone = wider if wider is not None and (tone is None or wider.quality == Quality.STEADY) else tone
        if tone is not None and tone.quality == Quality.TRANSIENT and self._shorten and periods >= 1.5:
            tone = self._shorter(buffer, channel, tone)
        self.frequency = math.nan if tone is None else tone.frequency
        return tone

    def _search(self, buffer: SampleBuffer, channel: int, count: int) -> Tone | None:
        """Seed from the newest `count` samples, then fit in the window that the seed defines."""
        s = self.settings
        signal = without_clipping(buffer.newest(count)[channel], s.saturation)
        seed = seed_frequency(signal, 1.0 / buffer.step, s.lowest_frequency, s.highest_frequency)
        if math.isnan(seed):
            return None
        # the seed is coarse; near the last frequency that one cuts whole periods better
        near = abs(seed / self.frequency - 1.0) < NEAR
        tone = self._in_window(buffer, channel, self.frequency if near else seed, s.window_periods, seed)
        if tone is not None and abs(tone.frequency / seed - 1.0) > RECUT:
            tone = self._in_window(buffer, channel, tone.frequency, s.window_periods)
        return tone

    def _shorter(self, buffer: SampleBuffer, channel: int, tone: Tone) -> Tone:
        """Return the newest period alone where it is certainly steady, which is a period earlier; else `tone`."""
        short = self._in_window(buffer, channel, tone.frequency, 1.0)
        if short is None or short.quality == Quality.POOR:
            return tone
        sure = math.sqrt(2.0 * (self.settings.change_likelihood + 2.0 * PENALTY))
        if tone.fit.foreign <= ALL_THERE_IS * short.fit.residual:
            return replace(tone, quality=Quality.POOR)
        hidden = short.fit.slope_std * short.fit.widened * sure > HIDDEN_CHANGE
        return replace(short, quality=Quality.TRANSIENT) if hidden else short

    def _count(self, buffer: SampleBuffer, periods: float, frequency: float) -> int:
        # whole where the period is: the last digits of the frequency do not add a sample
        return min(buffer.size, math.ceil(round(periods / (frequency * buffer.step), 6)))

    def _in_window(
        self, buffer: SampleBuffer, channel: int, frequency: float, periods: float, seed: float = math.nan
    ) -> Tone | None:
        """Fit in a window of `periods` of `frequency` [Hz], from `seed` [Hz] where another one is given."""
        count = self._count(buffer, periods, frequency)
        if count * buffer.step * frequency < ONE_PERIOD:
            return None
        signal = without_clipping(buffer.newest(count)[channel], self.settings.saturation)
        tau = buffer.times(count)
        valid = ~np.isnan(signal)
        lost = count - int(np.count_nonzero(valid))
        if lost:
            tau, signal = tau[valid], signal[valid]
        hum = TAU * self.settings.mains_frequency
        start = frequency if math.isnan(seed) else seed
        fit = fit_sine(tau, signal, TAU * start, hum, self.settings.change_likelihood, self.settings.slow_drift)
        return None if fit is None else self._judged(fit, count, lost, buffer)

    def _judged(self, fit: SineFit, count: int, lost: int, buffer: SampleBuffer) -> Tone | None:
        s, window = self.settings, count * buffer.step
        frequency = fit.omega / TAU
        significant = fit.amplitude > SIGNIFICANT * fit.residual * math.sqrt(2.0 / fit.used)
        inside = 0.9 * s.lowest_frequency < frequency < 1.1 * s.highest_frequency
        size = fit.amplitude / fit.omega**2 if self.acceleration else fit.amplitude
        if not (significant and inside and size >= s.least_amplitude and frequency * window >= ONE_PERIOD):
            return None
        return Tone(fit, window, lost * buffer.divisor, self._quality(fit, lost / count))

    def _quality(self, fit: SineFit, lost: float) -> Quality:
        s = self.settings
        if lost > s.poor_lost or (fit.change > 0.0 and lost > CHANGE_LOST):
            return Quality.POOR
        if fit.change > 0.0:
            return Quality.TRANSIENT
        # impacts bring tones of their own into the beam's motion
        foreign = self._shorten and math.isfinite(fit.foreign)
        # in an acceleration the second harmonic is four times as large, higher ones more
        harmonics = fit.harmonics / 4.0 if self.acceleration else fit.harmonics
        if foreign or fit.residual > s.poor_residual * fit.amplitude or harmonics > s.poor_harmonics:
            return Quality.POOR
        return Quality.STEADY
