# SPDX-License-Identifier: Apache-2.0
"""Baselines of the sine fit: the FFT bin the thesis picks, and three interpolations of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fft_bin(signal: Array) -> float:
    """Return twice the largest bin of the FFT of `signal` (n,) over n, the offset left out: the thesis's amplitude."""
    spectrum = np.abs(np.fft.rfft(signal - signal.mean()))
    return 2.0 * float(spectrum[1:].max()) / signal.size


def jacobsen(signal: Array) -> float:
    """Return the amplitude after Jacobsen's three-bin interpolation with Candan's correction (IEEE SPL 18, 2011)."""
    n = signal.size
    spectrum = np.fft.rfft(signal - signal.mean())
    k = 1 + int(np.argmax(np.abs(spectrum[1:-1])))
    left, middle, right = spectrum[k - 1], spectrum[k], spectrum[k + 1]
    below = 2.0 * middle - left - right
    delta = float(np.real((left - right) / below)) * math.tan(math.pi / n) / (math.pi / n) if below != 0.0 else 0.0
    return 2.0 * float(abs(middle)) / (n * max(np.sinc(min(max(delta, -0.9), 0.9)), 0.1))


def hann_parabola(signal: Array, padding: int = 8) -> float:
    """Return the amplitude at the vertex of a parabola through the padded spectrum's peak, Hann window, in decibels."""
    window = np.hanning(signal.size)
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * window, padding * signal.size))
    k = padding // 2 + int(np.argmax(spectrum[padding // 2 : -1]))
    left, middle, right = np.log(np.maximum(spectrum[k - 1 : k + 2], 1e-300))
    bend = left - 2.0 * middle + right
    delta = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return 2.0 * math.exp(middle - 0.25 * (left - right) * delta) / float(window.sum())


def plain_sine_fit(tau: Array, signal: Array, omega: float) -> float:
    """Return the amplitude of IEEE 1057's four-parameter fit as in the standard.

    `tau` and `signal` (n,) in [s] and [m], `omega` [rad/s] the seed.
    """
    a, b = 0.0, 0.0
    for _ in range(8):
        c, s = np.cos(omega * tau), np.sin(omega * tau)
        columns = np.stack([c, s, np.ones_like(tau), tau * (b * c - a * s)], axis=1)
        (a, b, _, step), *_ = np.linalg.lstsq(columns, signal, rcond=None)
        omega += step
    return float(math.hypot(a, b))
