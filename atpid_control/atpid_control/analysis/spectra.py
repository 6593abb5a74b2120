# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Auto and cross spectra by Welch's method, over the parts of a record without a gap: nothing is joined."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import signal

from atpid_control.analysis.signals import AnalysisError, runs
from atpid_sim.system import Array

#: Segments, half overlapping, of a record whose resolution is not given.
_SEGMENTS = 16
#: Squared correlation of neighbouring segments under a Hann window that overlap by half (Welch 1967): (1/6)^2.
_OVERLAP = 1.0 / 36.0
WINDOWS = ("hann", "boxcar", "flattop", "local")


@dataclass(frozen=True)
class Averaged:
    """Averaged spectra of two signals, one-sided densities (k,)."""

    frequency: Array  # (k,) [Hz]
    first: Array  # (k,) of the first signal [unit^2/Hz]
    second: Array  # (k,) of the second
    cross: Array  # (k,) E[conj(X) Y], complex
    segments: int
    averages: float  # independent ones
    enbw: float  # equivalent noise bandwidth of the window [Hz]


@dataclass(frozen=True)
class Spectrum:
    """Auto spectrum of a signal."""

    frequency: Array  # (k,) [Hz]
    density: Array  # (k,) one-sided power spectral density [unit^2/Hz]
    enbw: float  # equivalent noise bandwidth of a line [Hz]
    averages: float  # independent ones: the density's relative standard deviation is 1/sqrt of it
    unit: str

    @property
    def resolution(self) -> float:
        """Distance of two lines [Hz]."""
        return float(self.frequency[1] - self.frequency[0])

    @property
    def amplitude(self) -> Array:
        """Amplitude of a tone at each line (k,) [unit]: right at a line, up to 1.4 dB low between two (Hann)."""
        return np.asarray(np.sqrt(2.0 * self.density * self.enbw))

    @property
    def rms(self) -> float:
        """Root mean square by the sum over all lines [unit] (Parseval)."""
        return math.sqrt(float(self.density.sum()) * self.resolution)


def segment_length(samples: int, rate: float, resolution: float | None) -> int:
    """Return the samples of a segment for lines `resolution` [Hz] apart; AnalysisError where the record is shorter."""
    length = round(rate / resolution) if resolution else 2 * samples // (_SEGMENTS + 1)
    if length > samples:
        raise AnalysisError(
            f"resolution {resolution:g} Hz needs {length / rate:.4g} s without a gap, the record has "
            f"{samples / rate:.4g} s; give a longer part or --resolution {1.01 * rate / max(samples, 1):.2g}"
        )
    if length < 8:
        raise AnalysisError(f"{samples} samples without a gap give no spectrum; needed: {4 * (_SEGMENTS + 1)}")
    return length


def averaged(
    first: Array, second: Array, rate: float, resolution: float | None = None, window: str = "hann"
) -> Averaged:
    """Return the averaged spectra of two signals (n,), of the parts where neither is NaN. Raises AnalysisError."""
    parts = list(runs(np.isfinite(first + second)))
    length = segment_length(max((end - begin for begin, end in parts), default=0), rate, resolution)
    overlap = 0 if window == "boxcar" else length // 2
    sums = [np.zeros(length // 2 + 1), np.zeros(length // 2 + 1), np.zeros(length // 2 + 1, dtype=complex)]
    total = 0
    for begin, end in parts:
        count = (end - begin - overlap) // (length - overlap)
        if count < 1:
            continue
        pairs = ((first, first), (second, second), (first, second))
        for place, (x, y) in enumerate(pairs):
            _, density = signal.csd(x[begin:end], y[begin:end], rate, window, length, overlap)
            sums[place] = sums[place] + count * (density if place == 2 else density.real)
        total += count
    shape = signal.get_window(window, length)
    enbw = rate * float((shape**2).sum() / shape.sum() ** 2)
    averages = total if not overlap else total / (1.0 + 2.0 * _OVERLAP * (1.0 - 1.0 / total))
    lines = np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=np.float64)
    first_auto, second_auto, cross = (one / total for one in sums)
    return Averaged(lines, first_auto, second_auto, cross, total, averages, enbw)


def spectrum(
    values: Array, rate: float, resolution: float | None = None, window: str = "hann", unit: str = "m"
) -> Spectrum:
    """Return the auto spectrum of a signal (n,), NaN where a sample is missing. Raises AnalysisError."""
    found = averaged(values, values, rate, resolution, window)
    return Spectrum(found.frequency, found.first, found.enbw, found.averages, unit)
