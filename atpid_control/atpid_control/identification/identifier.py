# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One estimate of the excitation for each block of samples, in a window that slides with them."""

import math
from dataclasses import replace

import numpy as np

from atpid_common.vocabulary import Origin, Quality
from atpid_control.identification.estimate import ACCELERATION, Estimate, IdentificationError, Settings
from atpid_control.identification.excitation_kind import ExcitationWatch, OtherExcitation
from atpid_control.identification.from_beam import ModelInverse
from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.tone import Tone, ToneFinder
from atpid_control.identification.window import SampleBuffer, seed_frequency, smoothed_half_peak_to_peak
from atpid_sim.system import Array

#: Steady estimates differ by noise alone up to this many of their standard deviations.
SIGMAS = 6.0
#: A share of `change` this small in frequency counts as one: heights depend on it much more than on amplitude.
FREQUENCY_SHARE = 0.5


class ChangeTracker:
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
        amplitude = max(self.change * old.amplitude, SIGMAS * math.hypot(old.amplitude_std, new.amplitude_std))
        chance = SIGMAS * math.hypot(old.frequency_std, new.frequency_std)
        frequency = max(FREQUENCY_SHARE * self.change * old.frequency, chance)
        return abs(new.amplitude - old.amplitude) > amplitude or abs(new.frequency - old.frequency) > frequency


TAU = 2.0 * math.pi


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
        self._finder = ToneFinder(settings, shorten=inverse is None)
        self._tracker = ChangeTracker(settings.change, settings.slow_drift)
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
        self, first_index: int, rate: float, support: Array | None, beam: Array | None, t_last: float, *,
        delay: float = 0.0, height: float = math.nan, units: tuple[str, str] = ("m", "m"),
    ) -> Estimate:  # fmt: skip
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
            beam_amplitude /= (TAU * estimate.frequency) ** 2
        return replace(estimate, changed=changed, beam_amplitude=beam_amplitude)

    def _new_buffer(self, rate: float) -> SampleBuffer:
        s = self._settings
        if not rate >= 8.0 * s.highest_frequency:
            raise IdentificationError(
                f"rate: given {rate:g} Hz; allowed: at least 8 samples a period of the highest frequency, "
                f"{8.0 * s.highest_frequency:g} Hz; sample faster or lower highest_frequency"
            )
        self._finder, self._watch = ToneFinder(s, shorten=self._inverse is None), ExcitationWatch(s, rate)
        self._tracker = ChangeTracker(s.change, s.slow_drift)
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
        samples = np.full((2, given[0].size), np.nan)
        for row, channel in enumerate((support, beam)):
            if channel is not None:
                samples[row] = channel
        # an infinite reading is as invalid as none
        samples[np.isinf(samples)] = np.nan
        return samples

    def _filled(self, estimate: Estimate, tone: Tone, delay: float) -> Estimate:
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
            frequency_std=fit.omega_std / TAU,
            phase=math.remainder(phase, TAU),
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
        return smoothed_half_peak_to_peak(signal, buffer.step, frequency)
