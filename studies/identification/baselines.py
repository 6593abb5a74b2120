# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the sine fit is compared with: the Cramér-Rao bound, the FFT bin the thesis picks, and three interpolations."""

import math
from dataclasses import dataclass

import numpy as np

from atpid_sim.system import Array


@dataclass(frozen=True)
class Bound:
    """Least standard deviations any unbiased estimator can have."""

    amplitude: float  # [m]
    frequency: float  # [Hz]
    phase: float  # in the middle of the window [rad]
    offset: float  # [m]


def cramer_rao(amplitude: float, frequency: float, phase: float, samples: int, rate: float, noise: float) -> Bound:
    """Return the bound for A sin(2 pi f t + phase) + c, all four unknown, t = 0 in the middle of the window.

    It is the inverse of the Fisher information (Kay, Fundamentals of Statistical Signal Processing, 1993, section 3.9;
    with the offset as in Handel, IEEE Trans. Instrum. Meas. 49, 2000). All sums over equally spaced samples are
    geometric, so it has a closed form for any phase and any window, not only for whole periods.

    `amplitude` [m], `frequency` [Hz], `phase` [rad], `rate` [Hz], white `noise` [m] standard deviation.
    """
    a, b = amplitude * math.sin(phase), amplitude * math.cos(phase)
    information = fisher_information(a, b, 2.0 * math.pi * frequency / rate, samples) / noise**2
    covariance = np.linalg.inv(information)
    along = np.array([a, b]) / amplitude
    turn = np.array([b, -a]) / amplitude**2
    plane = covariance[:2, :2]
    return Bound(
        amplitude=math.sqrt(along @ plane @ along),
        frequency=math.sqrt(covariance[3, 3]) * rate / (2.0 * math.pi),
        phase=math.sqrt(turn @ plane @ turn),
        offset=math.sqrt(covariance[2, 2]),
    )


def fisher_information(a: float, b: float, omega: float, samples: int) -> Array:
    """Return the information (4, 4) about a, b, offset and angular frequency `omega` [rad/sample], for unit noise."""
    (c1, t1, _), (c2, t2, q2) = _sums(omega, samples), _sums(2.0 * omega, samples)
    squares = samples * (samples * samples - 1.0) / 12.0
    # derivative with respect to omega is n (b cos - a sin); odd sums vanish because n runs symmetrically about 0
    with_cosine, with_sine = -0.5 * a * t2, 0.5 * b * t2
    with_one = -a * t1
    omega_omega = 0.5 * (a * a + b * b) * squares + 0.5 * (b * b - a * a) * q2
    return np.array([
        [0.5 * (samples + c2), 0.0, c1, with_cosine],
        [0.0, 0.5 * (samples - c2), 0.0, with_sine],
        [c1, 0.0, float(samples), with_one],
        [with_cosine, with_sine, with_one, omega_omega],
    ])  # fmt: skip


def _sums(x: float, samples: int) -> tuple[float, float, float]:
    """Return the sums of cos(n x), n sin(n x) and n^2 cos(n x) over n = -(N-1)/2 ... (N-1)/2.

    The second is minus the first derivative of the first, the third minus its second derivative.
    """
    s, c = math.sin(0.5 * x), math.cos(0.5 * x)
    top, slope = math.sin(0.5 * samples * x), math.cos(0.5 * samples * x)
    n = float(samples)
    second = -0.25 * n * n * top / s - 0.5 * n * slope * c / s**2 + 0.25 * top / s + 0.5 * top * c * c / s**3
    return top / s, -(0.5 * samples * slope * s - 0.5 * top * c) / s**2, -second


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
