# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The newest samples, in order of their index: gaps are NaN, and fast streams are averaged down to what a fit needs."""

import math

import numpy as np

from atpid_sim.system import Array


class SampleBuffer:
    """The last `length` seconds of some channels, sample i at index i / rate; every `divisor` samples are averaged."""

    def __init__(self, channels: int, rate: float, length: float, analysis_rate: float) -> None:
        """Start empty; `rate` and `analysis_rate` in [Hz], `length` in [s]."""
        self.rate = rate
        self.divisor = max(1, math.floor(rate / analysis_rate))
        self.step = self.divisor / rate
        self._capacity = math.ceil(length / self.step) + 1
        self._data = np.empty((channels, 4 * self._capacity))
        self._end = 0  # samples held, including ones older than the capacity
        self._partial = np.empty((channels, 0))
        self._next: int | None = None  # index of the raw sample expected

    @property
    def size(self) -> int:
        """Averaged samples that can be read."""
        return min(self._end, self._capacity)

    def push(self, first_index: int, samples: Array) -> None:
        """Append raw `samples` (channels, n) whose first has `first_index`; what is missing before it becomes NaN.

        A stream that starts anew, or a gap longer than the buffer, empties it.
        """
        expected = self._next
        if expected is None or first_index < expected or first_index - expected > self._capacity * self.divisor:
            self._end, self._partial = 0, self._gap(first_index % self.divisor)
        elif first_index > expected:
            self._append(self._gap(first_index - expected))
        self._append(samples)
        self._next = first_index + samples.shape[1]

    def newest(self, count: int) -> Array:
        """Return the newest `count` averaged samples (channels, count), fewer where there are fewer."""
        return self._data[:, self._end - min(count, self.size) : self._end]

    def times(self, count: int) -> Array:
        """Return when they were taken (count,), 0 at the newest raw sample [s]."""
        count = min(count, self.size)
        newest = -(self._partial.shape[1] + 0.5 * (self.divisor - 1)) / self.rate
        return np.asarray(newest + (np.arange(count) - (count - 1)) * self.step, dtype=np.float64)

    def attenuation(self, frequency: float) -> float:
        """Return what averaging leaves of the amplitude of a tone at `frequency` [Hz]."""
        if self.divisor == 1:
            return 1.0
        x = math.pi * frequency / self.rate
        return math.sin(self.divisor * x) / (self.divisor * math.sin(x))

    def _gap(self, count: int) -> Array:
        return np.full((self._data.shape[0], count), np.nan)

    def _append(self, raw: Array) -> None:
        if self.divisor > 1:
            raw = np.concatenate((self._partial, raw), axis=1)
            whole = raw.shape[1] // self.divisor * self.divisor
            self._partial = raw[:, whole:]
            raw = raw[:, :whole].reshape(raw.shape[0], -1, self.divisor).mean(axis=2)
        raw = raw[:, -self._capacity :]
        count = raw.shape[1]
        if self._end + count > self._data.shape[1]:
            held = self._data[:, self._end - self.size : self._end].copy()
            self._end = held.shape[1]
            self._data[:, : self._end] = held
        self._data[:, self._end : self._end + count] = raw
        self._end += count


def without_clipping(signal: Array, saturation: tuple[float, float] | None) -> Array:
    """Return `signal` (n,) with NaN where the sensor was at its limit.

    `saturation` [m] holds the known limits; a flat top, three or more equal extreme samples in a row, counts as an
    unknown one.
    """
    clean = signal
    if saturation is not None:
        outside = (signal <= saturation[0]) | (signal >= saturation[1])
        if outside.any():
            clean = np.where(outside, np.nan, signal)
    for extreme in (np.fmax.reduce(clean, initial=-np.inf), np.fmin.reduce(clean, initial=np.inf)):
        flat = clean == extreme
        if flat.sum() >= 3 and (flat[:-2] & flat[1:-1] & flat[2:]).any():
            clean = np.where(flat, np.nan, clean)
    return clean


def smoothed_half_range(signal: Array, step: float, frequency: float) -> float:
    """Return half the range of `signal` (n,), `step` [s] apart, NaN where nothing is left of it.

    Noise widens a range of hundreds of samples by several standard deviations, so the signal is averaged over a
    fortieth of a period first, and the attenuation of a tone at `frequency` [Hz] is corrected.
    """
    length = 1 + 2 * int(round(0.0125 / (frequency * step), 6)) if frequency > 0.0 else 1
    if signal.size < length:
        return math.nan
    if length > 1:
        total = np.cumsum(np.concatenate(((0.0,), signal))) if not np.isnan(signal).any() else None
        if total is not None:
            smooth = (total[length:] - total[:-length]) / length
        else:
            smooth = np.lib.stride_tricks.sliding_window_view(signal, length).mean(axis=1)
        x = math.pi * frequency * step
        gain = math.sin(length * x) / (length * math.sin(x))
    else:
        smooth, gain = signal, 1.0
    smooth = smooth[~np.isnan(smooth)]
    return float(smooth.max() - smooth.min()) / (2.0 * gain) if smooth.size else math.nan


#: Zeros appended, as a multiple of the signal's length: the peak is then found to a fraction of what the fit can mend.
_PADDING = 4


def seed_frequency(signal: Array, rate: float, lowest: float, highest: float) -> float:
    """Return the frequency [Hz] of the strongest tone in `signal` (n,) taken at `rate` [Hz], between two limits [Hz].

    NaN samples are bridged by straight lines. NaN is returned where nothing varies or nothing lies between the limits.
    """
    values = _bridged(signal)
    if values is None:
        return math.nan
    size = 1 << math.ceil(math.log2(_PADDING * values.size))
    power = np.abs(np.fft.rfft(values - values.mean(), size))
    first, last = math.ceil(lowest * size / rate), min(math.floor(highest * size / rate), power.size - 2)
    if last <= first:
        return math.nan
    peak = first + int(np.argmax(power[first : last + 1]))
    if power[peak] == 0.0:
        return math.nan
    return min(max((peak + _vertex(power, peak)) * rate / size, lowest), highest)


def _vertex(power: Array, peak: int) -> float:
    """Offset in bins of the parabola's vertex through a peak and its neighbours, within half a bin."""
    if peak == 0:
        return 0.0
    left, middle, right = power[peak - 1 : peak + 2]
    bend = left - 2.0 * middle + right
    return 0.0 if bend >= 0.0 else float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))


def _bridged(signal: Array) -> Array | None:
    """Return the signal with its gaps bridged; None where too little of it is there."""
    missing = np.isnan(signal)
    count = int(missing.sum())
    if signal.size - count < 8:
        return None
    if count == 0:
        return signal
    index = np.arange(signal.size)
    bridged: Array = np.interp(index, index[~missing], signal[~missing])
    return bridged
