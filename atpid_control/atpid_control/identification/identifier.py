# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One estimate of the excitation for each block of samples, in a window that slides with them.

The tone is found by a seed, a window of whole periods and a fit, which shows its quality.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from atpid_common.vocabulary import Origin, Quality
from atpid_control.identification.choice import PENALTY
from atpid_control.identification.estimate import ACCELERATION, Estimate, IdentificationError, Settings
from atpid_control.identification.excitation_kind import ExcitationWatch, OtherExcitation
from atpid_control.identification.from_beam import ModelInverse
from atpid_control.identification.sine_fit import SineFit, fit_sine
from atpid_control.identification.window import SampleBuffer, seed_frequency, smoothed_half_range, without_clipping
from atpid_sim.system import Array

_TAU = 2.0 * math.pi
#: A tone must stand out of the residual by so many standard deviations: noise alone reaches it once in 10^10 fits.
_SIGNIFICANT = 7.0
#: Windows are cut by the seed's frequency, so one period may turn out this much shorter.
_ONE_PERIOD = 0.97
#: A window cut by a frequency further off than this is cut again.
_RECUT = 0.05
#: A seed this near to the last frequency is the same tone.
_NEAR = 0.15
#: One period may be called steady while two are not, if no larger change of amplitude can hide in its noise [-].
_HIDDEN_CHANGE = 0.02
#: With more than this share of the samples lost a change cannot be distinguished from the gaps.
_CHANGE_LOST = 0.25
#: Over the residual of the newest period alone: what leaves less in the whole window is there, and no change.
_ALL_THERE_IS = 1.2


@dataclass(frozen=True)
class _Tone:
    """A fitted tone, its window and what was missing from it."""

    fit: SineFit
    window: float  # [s]
    lost: int
    quality: Quality

    @property
    def frequency(self) -> float:
        """Frequency [Hz]."""
        return self.fit.omega / _TAU


class _ToneFinder:
    """Follows the tone of one channel of a buffer."""

    def __init__(self, settings: Settings, shorten: bool = True) -> None:
        """Start without a frequency; with `shorten` a transient is looked at in one period, too."""
        self.settings, self._shorten = settings, shorten
        self.frequency = math.nan  # of the last tone found [Hz]
        self.acceleration = False  # whether the channel is one [m/s^2]

    def find(self, buffer: SampleBuffer, channel: int) -> _Tone | None:
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

    def _search(self, buffer: SampleBuffer, channel: int, count: int) -> _Tone | None:
        """Seed from the newest `count` samples, then fit in the window that the seed defines."""
        s = self.settings
        signal = without_clipping(buffer.newest(count)[channel], s.saturation)
        seed = seed_frequency(signal, 1.0 / buffer.step, s.lowest_frequency, s.highest_frequency)
        if math.isnan(seed):
            return None
        # the seed is coarse; near the last frequency that one cuts whole periods better
        near = abs(seed / self.frequency - 1.0) < _NEAR
        tone = self._in_window(buffer, channel, self.frequency if near else seed, s.window_periods, seed)
        if tone is not None and abs(tone.frequency / seed - 1.0) > _RECUT:
            tone = self._in_window(buffer, channel, tone.frequency, s.window_periods)
        return tone

    def _shorter(self, buffer: SampleBuffer, channel: int, tone: _Tone) -> _Tone:
        """Return the newest period alone where it is certainly steady, which is a period earlier; else `tone`."""
        short = self._in_window(buffer, channel, tone.frequency, 1.0)
        if short is None or short.quality == Quality.POOR:
            return tone
        sure = math.sqrt(2.0 * (self.settings.change_likelihood + 2.0 * PENALTY))
        if tone.fit.foreign <= _ALL_THERE_IS * short.fit.residual:
            return replace(tone, quality=Quality.POOR)
        hidden = short.fit.slope_std * short.fit.widened * sure > _HIDDEN_CHANGE
        return replace(short, quality=Quality.TRANSIENT) if hidden else short

    def _count(self, buffer: SampleBuffer, periods: float, frequency: float) -> int:
        # whole where the period is: the last digits of the frequency do not add a sample
        return min(buffer.size, math.ceil(round(periods / (frequency * buffer.step), 6)))

    def _in_window(
        self, buffer: SampleBuffer, channel: int, frequency: float, periods: float, seed: float = math.nan
    ) -> _Tone | None:
        """Fit in a window of `periods` of `frequency` [Hz], from `seed` [Hz] where another one is given."""
        count = self._count(buffer, periods, frequency)
        if count * buffer.step * frequency < _ONE_PERIOD:
            return None
        signal = without_clipping(buffer.newest(count)[channel], self.settings.saturation)
        tau = buffer.times(count)
        valid = ~np.isnan(signal)
        lost = count - int(np.count_nonzero(valid))
        if lost:
            tau, signal = tau[valid], signal[valid]
        hum = _TAU * self.settings.mains_frequency
        start = frequency if math.isnan(seed) else seed
        fit = fit_sine(tau, signal, _TAU * start, hum, self.settings.change_likelihood, self.settings.slow_drift)
        return None if fit is None else self._judged(fit, count, lost, buffer)

    def _judged(self, fit: SineFit, count: int, lost: int, buffer: SampleBuffer) -> _Tone | None:
        s, window = self.settings, count * buffer.step
        frequency = fit.omega / _TAU
        significant = fit.amplitude > _SIGNIFICANT * fit.residual * math.sqrt(2.0 / fit.used)
        inside = 0.9 * s.lowest_frequency < frequency < 1.1 * s.highest_frequency
        size = fit.amplitude / fit.omega**2 if self.acceleration else fit.amplitude
        if not (significant and inside and size >= s.least_amplitude and frequency * window >= _ONE_PERIOD):
            return None
        return _Tone(fit, window, lost * buffer.divisor, self._quality(fit, lost / count))

    def _quality(self, fit: SineFit, lost: float) -> Quality:
        s = self.settings
        if lost > s.poor_lost or (fit.change > 0.0 and lost > _CHANGE_LOST):
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


#: Steady estimates differ by noise alone up to this many of their standard deviations.
_SIGMAS = 6.0
#: A share of `change` this small in frequency counts as one: heights depend on it much more than on amplitude.
_FREQUENCY_SHARE = 0.5


class _ChangeTracker:
    """Compares each estimate with the first steady one since the last change.

    `changed` stays true from the first sign of a change up to and including the steady estimate that ends it. The first
    steady estimate of all is a change too: from nothing. A frequency that drifts slowly takes the one it is compared
    with along, so that it never differs by a step.
    """

    def __init__(self, change: float, slow_drift: float = 0.0) -> None:
        """Take the relative change of amplitude that counts [-], and the relative rate of a slow drift [1/s]."""
        self.change, self.slow_drift = change, slow_drift
        self._reference: Estimate | None = None
        self._at = math.nan  # when the reference's frequency was taken along last [s]
        self._pending = False

    def judge(self, estimate: Estimate) -> bool:
        """Return whether a change was seen, this estimate included."""
        quality = estimate.quality
        if quality == Quality.POOR:
            return self._pending
        if quality != Quality.STEADY:
            self._pending = self._pending or quality == Quality.TRANSIENT or self._reference is not None
            return self._pending
        seen = self._pending or self._reference is None or self._differ(self._reference, estimate)
        if seen or self._reference is None:
            self._reference, self._at = estimate, estimate.time
        else:
            self._reference = self._taken_along(self._reference, estimate)
        self._pending = False
        return seen

    def _taken_along(self, old: Estimate, new: Estimate) -> Estimate:
        """Return the estimate to compare with from now on: its frequency follows at the rate of a slow drift."""
        passed = new.time - self._at
        self._at = new.time
        most = self.slow_drift * old.frequency * passed
        if not most > 0.0:
            return old
        return replace(old, frequency=old.frequency + min(max(new.frequency - old.frequency, -most), most))

    def _differ(self, old: Estimate, new: Estimate) -> bool:
        amplitude = max(self.change * old.amplitude, _SIGMAS * math.hypot(old.amplitude_std, new.amplitude_std))
        chance = _SIGMAS * math.hypot(old.frequency_std, new.frequency_std)
        frequency = max(_FREQUENCY_SHARE * self.change * old.frequency, chance)
        return abs(new.amplitude - old.amplitude) > amplitude or abs(new.frequency - old.frequency) > frequency


def warm_up() -> None:
    """Compile the fit, or load it from the cache, so that the first samples do not wait for it (some 10 s once)."""
    tau = np.linspace(-0.4, 0.0, 401)
    fit_sine(tau, np.sin(30.0 * tau), 30.0, 0.0, math.inf)


class Identifier:
    """Takes blocks of samples and returns an estimate for each; its only clock is that of the samples."""

    def __init__(self, settings: Settings, inverse: ModelInverse | None = None) -> None:
        """With `inverse` the excitation is inferred from the beam, otherwise read from the support."""
        self._settings, self._inverse = settings, inverse
        # the growth of a transient beam is estimated better in a longer window
        self._finder = _ToneFinder(settings, shorten=inverse is None)
        self._tracker = _ChangeTracker(settings.change, settings.slow_drift)
        self._watch: ExcitationWatch | None = None
        self._buffer: SampleBuffer | None = None
        self._last_index = 0
        self.source = Origin.SUPPORT if inverse is None else Origin.BEAM

    @property
    def other(self) -> OtherExcitation | None:
        """What excites the structure where that is no tone; None: one tone, or nothing, or it is not looked for."""
        return None if self._watch is None else self._watch.found

    def configure(self, settings: Settings) -> None:
        """Identify with other thresholds from the next block on; window, frequencies and rates stay what they are."""
        self._settings = self._finder.settings = settings
        if self._watch is not None:
            self._watch.share = settings.second_tone
        self._tracker.change, self._tracker.slow_drift = settings.change, settings.slow_drift

    def push(
        self,
        first_index: int,
        rate: float,
        support: Array | None,
        beam: Array | None,
        t_last: float,
        *,
        delay: float = 0.0,
        height: float = math.nan,
        units: tuple[str, str] = ("m", "m"),
    ) -> Estimate:
        """Take the next block and return the estimate at its last sample.

        `support` and `beam` are (n,) [m], NaN where invalid, or None where not measured; `rate` [Hz]; `t_last` [s] is
        when the last scan was taken and is only passed on; `delay` [s]: the channel's sampling after its scan;
        `height` [m]: of the ceiling; `units`: of both, of m/s^2 the estimate is the displacement's. Missing blocks show
        in `first_index`. Raises IdentificationError for impossible samples: no channel at all, a rate too low for the
        tones looked for, a tone too slow for an acceleration's noise.
        """
        samples = self._stacked(support, beam)
        if self._buffer is None or self._buffer.rate != rate:
            self._buffer = self._new_buffer(rate)
        self._buffer.push(first_index, samples)
        self._last_index = max(first_index + samples.shape[1] - 1, 0)
        self._finder.acceleration = units[self.source] == ACCELERATION
        tone = self._finder.find(self._buffer, self.source)
        estimate = Estimate(time=t_last, last_index=self._last_index, origin=self.source)
        if tone is not None:
            estimate = self._filled(estimate, tone, delay)
        estimate = estimate.displaced() if self._finder.acceleration else estimate
        if self._inverse is not None:
            estimate = self._inverse.support_of(estimate, height)
        # impacts bring tones of their own into the beam's motion
        elif self._is_no_tone(first_index, samples[self.source], estimate) and estimate.quality != Quality.NONE:
            estimate = replace(estimate, quality=Quality.POOR)
        changed = self._tracker.judge(estimate)
        beam_amplitude = self._beam_amplitude(estimate, beam is not None)
        if units[Origin.BEAM] == ACCELERATION:
            beam_amplitude /= (_TAU * estimate.frequency) ** 2
        return replace(estimate, changed=changed, beam_amplitude=beam_amplitude)

    def _new_buffer(self, rate: float) -> SampleBuffer:
        s = self._settings
        if not rate >= 8.0 * s.highest_frequency:
            raise IdentificationError(
                f"rate: given {rate:g} Hz; allowed: at least 8 samples a period of the highest frequency, "
                f"{8.0 * s.highest_frequency:g} Hz; sample faster or lower highest_frequency"
            )
        self._finder, self._watch = _ToneFinder(s, shorten=self._inverse is None), ExcitationWatch(s, rate)
        self._tracker = _ChangeTracker(s.change, s.slow_drift)
        return SampleBuffer(2, rate, s.window_periods / s.lowest_frequency, s.analysis_rate)

    def _is_no_tone(self, first_index: int, samples: Array, estimate: Estimate) -> bool:
        assert self._watch is not None
        found = self._watch.push(first_index, samples, estimate)
        return found is not None and found.spoils

    def _stacked(self, support: Array | None, beam: Array | None) -> Array:
        given = [channel for channel in (support, beam) if channel is not None]
        if not given or (support if self._inverse is None else beam) is None:
            needed = "support" if self._inverse is None else "beam"
            raise IdentificationError(f"{needed}: given no samples; allowed: the displacement of the {needed} [m]")
        nothing = np.full(given[0].size, np.nan)
        samples = np.array([nothing if one is None else one for one in (support, beam)], dtype=np.float64)
        # an infinite reading is as invalid as none
        samples[np.isinf(samples)] = np.nan
        return samples

    def _filled(self, estimate: Estimate, tone: _Tone, delay: float) -> Estimate:
        assert self._buffer is not None
        fit = tone.fit
        gain = self._buffer.attenuation(tone.frequency)
        phase = fit.phase - fit.omega * delay
        return replace(
            estimate,
            quality=tone.quality,
            amplitude=fit.amplitude / gain,
            amplitude_std=fit.amplitude_std / gain,
            frequency=tone.frequency,
            frequency_std=fit.omega_std / _TAU,
            phase=math.remainder(phase, _TAU),
            phase_std=fit.phase_std,
            offset=fit.offset,
            window=tone.window,
            residual=fit.residual,
            harmonics=fit.harmonics,
            used=fit.used,
            lost=tone.lost,
            growth=fit.slope * 2.0 / tone.window,
            growth_std=fit.slope_std * 2.0 / tone.window,
            drift=fit.drift,
        )

    def _beam_amplitude(self, estimate: Estimate, measured: bool) -> float:
        """Half peak-to-peak of the beam over the excitation's window, or its own where the support stands still."""
        buffer, s = self._buffer, self._settings
        if not measured or buffer is None:
            return math.nan
        frequency, window = estimate.frequency, estimate.window
        if math.isnan(frequency):
            everything = buffer.newest(buffer.size)[Origin.BEAM]
            frequency = seed_frequency(everything, 1.0 / buffer.step, s.lowest_frequency, s.highest_frequency)
            window = s.window_periods / frequency
        if math.isnan(frequency):
            return math.nan
        signal = buffer.newest(math.ceil(window / buffer.step))[Origin.BEAM]
        return smoothed_half_range(signal, buffer.step, frequency)
