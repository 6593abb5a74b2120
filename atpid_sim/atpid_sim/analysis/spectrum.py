# SPDX-License-Identifier: Apache-2.0
"""The spectrum of a displacement, and the frequency of its highest peak (Figs 3.7 and 3.8)."""

import numpy as np

from atpid_sim.system import Array

#: Zeros appended, in lengths of the signal: the spectrum is then read between its bins.
_PADDING = 8


def amplitude_spectrum(displacement: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies (m,) [Hz] and amplitudes (m,) [m] of a displacement (n,) [m] sampled at `rate` [Hz].

    The mean is removed; the signal is neither windowed nor scaled beyond 2 / n, so that a tone over whole periods has
    its own amplitude.
    """
    count = len(displacement)
    spectrum = np.abs(np.fft.rfft(displacement - displacement.mean(), _PADDING * count))
    frequencies = np.fft.rfftfreq(_PADDING * count, 1.0 / rate)
    return np.asarray(frequencies, dtype=float), 2.0 * spectrum / count


def dominant_frequency(displacement: Array, rate: float) -> float:
    """Return the frequency [Hz] of the highest peak, the vertex of a parabola through its three samples."""
    frequencies, amplitudes = amplitude_spectrum(displacement, rate)
    top = 1 + int(np.argmax(amplitudes[1:-1]))
    left, middle, right = amplitudes[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(frequencies[top] + shift * frequencies[1])
