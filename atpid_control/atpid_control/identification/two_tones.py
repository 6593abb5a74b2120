# SPDX-License-Identifier: Apache-2.0
"""A second tone in the excitation, which the window of two periods cannot distinguish from a change of the first.

Eleven periods are looked at. A tone that steps, ramps or drifts in them is not two steady ones: it leaves a residual
that two do not. Nearer than 0.14 of the frequency two tones are a beat, whose amplitude is followed as it changes.
"""

import math
from dataclasses import dataclass

import numpy as np

from atpid_control.identification.estimate import Settings
from atpid_control.identification.window import SampleBuffer, seed_frequency
from atpid_sim.system import Array

TAU = 2.0 * math.pi
#: Periods of the first tone that are looked at, and samples of each after averaging.
PERIODS, _A_PERIOD = 11.0, 40
#: Two tones are apart by this many cycles in that time; so far from a harmonic of the first a tone is none of it.
_APART = 1.5
#: Harmonics of the first tone that are no second one.
_HARMONICS = (2.0, 3.0, 4.0, 5.0)
#: Residual of both tones over the effective value of the second up to which they are all there is [-].
_LEFT = 0.3
#: What one tone leaves, over the effective value of a second one that would count, up to which there is none [-].
_ALONE = 0.5
#: Gauss-Newton steps from the peaks of the spectrum; looks in a row that agree; periods between looks.
_STEPS, _AGREEING, _BETWEEN = 6, 2, 1.0
#: With more than this share of the samples missing it is not judged.
_MISSING = 0.1


@dataclass(frozen=True)
class TwoTones:
    """Two steady tones: the larger first."""

    frequencies: tuple[float, float]  # [Hz]
    amplitudes: tuple[float, float]  # [m, of forces N]

    def sentence(self, unit: str) -> str:
        """Return what is refused, and why; unit: of the amplitudes."""
        (f1, f2), (a1, a2) = self.frequencies, self.amplitudes
        found = f"{a1:.3g} {unit} at {f1:.4g} Hz and {a2:.3g} {unit} at {f2:.4g} Hz"
        return f"two tones excite the structure, {found}: a height is selected for one; the ceiling stays"


class TwoToneWatch:
    """Looks for a second tone in the newest samples of one channel, once a period."""

    def __init__(self, settings: Settings, rate: float) -> None:
        """Take the share of the first amplitude that counts and the limits of tones; samples come at `rate` [Hz]."""
        self.share, self._hum = settings.second_tone, settings.mains_frequency
        self._limits = settings.lowest_frequency, settings.highest_frequency
        self._buffer = SampleBuffer(1, rate, PERIODS / settings.lowest_frequency, settings.analysis_rate)
        self.found: TwoTones | None = None
        self._next = 0.0  # when to look again [s]
        self._votes = 0

    def push(self, first_index: int, samples: Array, time: float, frequency: float) -> TwoTones | None:
        """Take the next samples (n,) [m], the last at `time` [s]; return the two tones, None where there is one.

        frequency: of the tone found in them [Hz], NaN: none.
        """
        self._buffer.push(first_index, samples[None])
        if self.found is not None:  # the estimate's frequency wanders between two
            frequency = self.found.frequencies[0]
        if not self.share > 0.0 or math.isnan(frequency):
            self.found, self._votes = None, 0
        elif not self._next - 2.0 * PERIODS / frequency <= time < self._next:
            self._next = round(time + _BETWEEN / frequency, 6)
            now = self._look(frequency)
            self._votes = self._votes + 1 if (now is None) != (self.found is None) else 0
            if self._votes >= _AGREEING or (now is not None and self.found is not None):
                self.found, self._votes = now, 0
        return self.found

    def _look(self, frequency: float) -> TwoTones | None:
        buffer = self._buffer
        count = math.ceil(round(PERIODS / (frequency * buffer.step), 6))
        if count > buffer.size:
            return None
        signal = buffer.newest(count)[0]
        stride = max(1, int(round(1.0 / (_A_PERIOD * frequency * buffer.step), 6)))
        whole = signal[: signal.size // stride * stride].reshape(-1, stride)
        y, step = whole.mean(axis=1), stride * buffer.step
        valid = np.isfinite(y)
        if np.count_nonzero(~valid) > _MISSING * y.size:
            return None
        t, y = np.arange(y.size)[valid] * step, y[valid]
        values, left = _fitted(t, y, [frequency])
        if float(np.sqrt(np.mean(left**2))) < _ALONE * self.share * float(np.hypot(*values[:2])) / math.sqrt(2.0):
            return None
        return self._two(t, y, step)

    def _two(self, t: Array, y: Array, step: float) -> TwoTones | None:
        length = t[-1] - t[0]
        seeds: list[float] = []
        left = y
        for _ in range(2):
            seeds.append(seed_frequency(left * np.hanning(left.size), 1.0 / step, *self._limits))
            if math.isnan(seeds[-1]):
                return None
            left = _fitted(t, y, seeds)[1]
        fit = _converged(t, y, seeds, length)
        if fit is None:
            return None
        frequencies, amplitudes, residual = fit
        order = np.argsort(amplitudes)[::-1]
        (f1, f2), (a1, a2) = frequencies[order], amplitudes[order]
        low, high = self._limits
        beside = [f1, *(k * f1 for k in _HARMONICS), *([self._hum] if self._hum > 0.0 else [])]
        apart = all(abs(f2 - other) * length >= _APART for other in beside)
        if not (apart and low <= f2 <= high and a2 >= self.share * a1 and residual <= _LEFT * a2 / math.sqrt(2.0)):
            return None
        return TwoTones((float(f1), float(f2)), (float(a1), float(a2)))


def _converged(t: Array, y: Array, seeds: list[float], length: float) -> tuple[Array, Array, float] | None:
    """Return frequencies (2,) [Hz], amplitudes (2,) [m] and effective residual [m] of two tones; None: no such fit."""
    frequencies = np.array(seeds)
    for _ in range(_STEPS):
        values, left = _fitted(t, y, frequencies)
        cosine, sine = values[0:4:2], values[1:4:2]
        angles = TAU * np.outer(frequencies, t)
        slopes = TAU * t * (sine[:, None] * np.cos(angles) - cosine[:, None] * np.sin(angles))
        columns = np.vstack([_columns(t, frequencies), slopes])
        change = np.linalg.lstsq(columns.T, left, rcond=None)[0][-2:]
        frequencies = frequencies + np.clip(change, -0.5 / length, 0.5 / length)
        if not (np.isfinite(frequencies).all() and (frequencies > 0.0).all()):
            return None
    values, left = _fitted(t, y, frequencies)
    return frequencies, np.hypot(values[0:4:2], values[1:4:2]), float(np.sqrt(np.mean(left**2)))


def _columns(t: Array, frequencies: Array | list[float]) -> Array:
    """Return cosine and sine of each frequency [Hz], an offset and a drift (2 n + 2, samples)."""
    tones = [function(TAU * frequency * t) for frequency in frequencies for function in (np.cos, np.sin)]
    return np.vstack([*tones, np.ones_like(t), t - t.mean()])


def _fitted(t: Array, y: Array, frequencies: Array | list[float]) -> tuple[Array, Array]:
    """Return the coefficients of the columns and what they leave of `y` (n,) [m]."""
    columns = _columns(t, frequencies)
    values = np.asarray(np.linalg.lstsq(columns.T, y, rcond=None)[0], dtype=np.float64)
    return values, np.asarray(y - values @ columns)
