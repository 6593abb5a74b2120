# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Auto and cross spectra by Welch's method, over the parts of a record without a gap: nothing is joined.

By numpy alone: scipy.signal takes longer to import than everything else that a report needs together.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_control.analysis.signals import AnalysisError, runs
from atpid_sim.system import Array

#: Segments, half overlapping, of a record whose resolution is not given.
_SEGMENTS = 16
#: Squared correlation of neighbouring segments under a Hann window that overlap by half (Welch 1967): (1/6)^2.
_OVERLAP = 1.0 / 36.0
WINDOWS = ("hann", "boxcar", "flattop", "local")
#: Coefficients of the windows' cosines.
_COSINES = {
    "hann": (0.5, -0.5),
    "boxcar": (1.0,),
    "flattop": (0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368),
}


@dataclass(frozen=True)
class _Averaged:
    """Averaged spectra of two signals, one-sided densities (k,)."""

    frequency: Array  # (k,) [Hz]
    first: Array  # (k,) of the first signal [unit^2/Hz]
    second: Array  # (k,) of the second
    cross: Array  # (k,) E[conj(X) Y], complex
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


def _segment_length(samples: int, rate: float, resolution: float | None) -> int:
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
) -> _Averaged:
    """Return the averaged spectra of two signals (n,), of the parts where neither is NaN. Raises AnalysisError."""
    parts = list(runs(np.isfinite(first + second)))
    length = _segment_length(max((end - begin for begin, end in parts), default=0), rate, resolution)
    overlap = 0 if window == "boxcar" else length // 2
    shape = window_of(window, length)
    sums = np.zeros((3, length // 2 + 1), dtype=complex)
    total = 0
    for begin, end in parts:
        for start in range(begin, end - length + 1, length - overlap):
            x, y = (transform(one[start : start + length], shape) for one in (first, second))
            sums += x.conj() * x, y.conj() * y, x.conj() * y
            total += 1
    sums *= _sides(length) / (rate * float((shape**2).sum()) * total)
    enbw = rate * float((shape**2).sum() / shape.sum() ** 2)
    averages = total if not overlap else total / (1.0 + 2.0 * _OVERLAP * (1.0 - 1.0 / total))
    lines = np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=np.float64)
    return _Averaged(lines, sums[0].real, sums[1].real, sums[2], averages, enbw)


def window_of(name: str, length: int) -> Array:
    """Return a window (length,) that is periodic, as transforms need it; names: `hann`, `boxcar`, `flattop`."""
    turns = 2.0 * np.pi * np.arange(length) / length
    return np.asarray(sum(factor * np.cos(k * turns) for k, factor in enumerate(_COSINES[name])))


def transform(values: Array, shape: Array) -> NDArray[np.complex128]:
    """Return the transform (n // 2 + 1,) of values (n,) without their mean, under a window (n,)."""
    return np.fft.rfft(shape * (values - values.mean()))


def _sides(length: int) -> Array:
    """Weight of each line (length // 2 + 1,) of a one-sided density: 1 for the two that have no other side."""
    weights = np.full(length // 2 + 1, 2.0)
    weights[0] = 1.0
    if length % 2 == 0:
        weights[-1] = 1.0
    return weights


def spectrum(
    values: Array, rate: float, resolution: float | None = None, window: str = "hann", unit: str = "m"
) -> Spectrum:
    """Return the auto spectrum of a signal (n,), NaN where a sample is missing. Raises AnalysisError."""
    found = averaged(values, values, rate, resolution, window)
    return Spectrum(found.frequency, found.first, found.enbw, found.averages, unit)
