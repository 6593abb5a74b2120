# SPDX-License-Identifier: Apache-2.0
"""Where the fit starts: the highest peak of a zero-padded FFT."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Zeros appended, as a multiple of the signal's length: the peak is then found to a fraction of what the fit can mend.
PADDING = 4


def seed_frequency(signal: Array, rate: float, lowest: float, highest: float) -> float:
    """Return the frequency [Hz] of the strongest tone in `signal` (n,) taken at `rate` [Hz], between two limits [Hz].

    NaN samples are bridged by straight lines. NaN is returned where nothing varies or nothing lies between the limits.
    """
    values = _bridged(signal)
    if values is None:
        return math.nan
    size = 1 << math.ceil(math.log2(PADDING * values.size))
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
