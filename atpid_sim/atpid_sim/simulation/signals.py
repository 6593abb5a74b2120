# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signals as rows of the drive table, in whatever unit [U]: sums of tones, random signals, a twice integrated pulse."""

import math
from collections.abc import Sequence

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import SceneError
from atpid_sim.scene.drives import Density, band_power
from atpid_sim.scene.series import smooth_rise
from atpid_sim.system import Array

#: Knots a period of a tone: its cubic spline is then within 2.5e-9 of its amplitude ((2 pi / 200)^4 / 384).
KNOTS_A_PERIOD = 200
#: Knots at most: their table and what is computed from it fill 2 GB.
MOST_KNOTS = 5_000_000
#: Knots a period of the highest frequency, however little of the signal it has: its second derivative is within 0.4 %.
_FEWEST_A_PERIOD = 32
#: Knots beyond the end of a random signal: what its spline does there has faded by 0.27 from each to the next.
_BEYOND = 20
#: Periods of the lowest frequency in a segment of the check, and its bands.
_SEGMENT, _BANDS = 32, 8
#: Probability that a right realisation lies outside a band of the check, and what the spline may add.
_CHANCE, _BY_SPLINE = 1e-9, 0.01


def tone_rows(tones: Sequence[tuple[float, float, float]], duration: float, key: str) -> Array:
    """Return the rows (n, 12) of a sum of tones (amplitude [U], frequency [Hz], phase at time zero [rad]) in `key`.

    Within 2.5e-9 of the sum's root mean square times sqrt 2. Raises SceneError where that takes too many rows.
    """
    from scipy.interpolate import CubicSpline  # here, as in `excitation`

    heard = [tone for tone in tones if tone[0] > 0.0]
    if not heard:
        return drive.still_rows(duration)
    square, eighth = (sum(a * a * f**power for a, f, _ in heard) for power in (0, 8))
    count = _knots(square, eighth, max(f for _, f, _ in heard), duration, key)
    times = np.linspace(0.0, duration, count + 1)
    values, slopes = np.zeros(count + 1), np.zeros(2)
    for a, f, phase in heard:
        angle = 2.0 * math.pi * np.mod(f * times, 1.0) + phase  # whole turns are left out: late phases keep digits
        values += a * np.sin(angle)
        slopes += 2.0 * math.pi * f * a * np.cos(angle[[0, -1]])
    spline = CubicSpline(times, values, bc_type=((1, slopes[0]), (1, slopes[1])))
    return drive.spline_rows(times, spline.c, duration)


def random_rows(
    density: Density, duration: float, rise: float, seed: Sequence[int], key: str, checked_derivative: int = 0
) -> Array:
    """Return the rows (n, 12) of one realisation of a Gaussian signal of a one-sided density [U^2/Hz], asked by `key`.

    It is a sum of tones half as far apart as the run's own resolution, each with the power of its interval and
    independent normal parts in and out of phase, periodic in twice the `duration` [s] (Shinozuka and Deodatis 1991,
    with random amplitudes). It grows from rest within `rise` [s] as 10 s^3 - 15 s^4 + 6 s^5. The spline is within
    2.5e-9 of the amplitude of a tone with its power. Of the signal, or its second derivative (checked_derivative 2),
    Welch's estimate is compared with the density asked for. Raises SceneError for a run too short or too many rows,
    NumericalFailure where the density is missed by more than chance.
    """
    from scipy.fft import irfft, next_fast_len
    from scipy.interpolate import CubicSpline

    low, high = density[0][0], density[-1][0]
    if duration * low < 1.0 or rise > 0.5 * duration:
        raise SceneError(
            f"{key}: given a lowest frequency of {low:g} Hz and a rise of {rise:g} s in a run of {duration:g} s; "
            "allowed: a run of at least one period of it, and of twice the rise; a longer duration"
        )
    weighted = tuple((f, value * f**8) for f, value in density)
    square, eighth = (float(band_power(part, [low, high])[0]) for part in (density, weighted))
    count = _knots(square, eighth, high, duration, key)
    step = duration / count
    length = next_fast_len(2 * (count + _BEYOND), real=True)
    spacing = 1.0 / (length * step)
    lines = math.ceil(high / spacing) + 2
    powers = band_power(density, (np.arange(lines + 1) - 0.5) * spacing)
    parts = np.random.default_rng(seed).standard_normal((lines, 2)) @ np.array([0.5, -0.5j])
    values = irfft(np.sqrt(powers) * parts, length)[: count + _BEYOND] * length
    times: Array = step * np.arange(count + _BEYOND, dtype=np.float64)
    values *= smooth_rise(times, rise)
    spline = CubicSpline(times, values, bc_type=("clamped", "not-a-knot"))
    settled = slice(math.ceil(rise / step), count)
    weights = (2.0 * math.pi * spacing * np.arange(lines)) ** (2 * checked_derivative)
    found = spline.c[3, settled] if checked_derivative == 0 else 2.0 * spline.c[1, settled]
    _require_density(found, 1.0 / step, powers * weights, (length, low, high), key)
    rows = drive.spline_rows(times[: count + 1], spline.c[:, :count], math.inf)
    rows[-1, columns.END] = duration
    return rows


def pulse_rows(peak: float, pulse: float, at: float, compensation: float, duration: float, key: str) -> Array:
    """Return the rows (n, 12), exact, of a signal at rest whose second derivative is a half sine, then brought to rest.

    The half sine has its peak [U/s^2], the length `pulse` [s] and begins at `at` [s]; within `compensation` [s] after
    it the second derivative is -peak (4 pulse / pi compensation) sin^2(pi s / compensation), so that the signal
    ends at rest. Raises SceneError where it does not come to rest within the duration [s].
    """
    end = at + pulse + compensation
    if end > duration:
        raise SceneError(
            f"{key}: given one that comes to rest after {end:g} s; allowed: within the run ({duration:g} s)"
        )
    omega, slow = math.pi / pulse, 2.0 * math.pi / compensation
    speed, first = 2.0 * peak / omega, peak / omega * pulse
    wave = speed * compensation / (4.0 * math.pi**2)
    places = [columns.START, columns.END, columns.A0, columns.OMEGA, columns.PHASE, columns.C0, columns.C1, columns.C2]
    rows = np.zeros((4, columns.DRIVE_COLUMNS))
    rows[:, places] = (
        (0.0, at, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (at, at + pulse, -peak / omega**2, omega, 0.0, 0.0, peak / omega, 0.0),
        (at + pulse, end, -wave, slow, 0.5 * math.pi, first + wave, speed, -0.5 * speed / compensation),
        (end, duration, 0.0, 0.0, 0.0, first + 0.5 * speed * compensation, 0.0, 0.0),
    )
    return rows[rows[:, columns.END] > rows[:, columns.START]]


def root_mean_squares(rows: Array, begin: float, end: float) -> tuple[float, float]:
    """Return the root mean square of a spline about its mean [U], and of its second derivative [U/s^2], at its knots.

    Those in [begin, end] [s] are taken for the time up to the next one.
    """
    inside = drive.between(rows, begin, end)
    share = (inside[:, columns.END] - inside[:, columns.START]) / (end - begin)
    value, second = inside[:, columns.C0], 2.0 * inside[:, columns.C2]
    return math.sqrt(share @ (value - share @ value) ** 2), math.sqrt(share @ second**2)


def _knots(square: float, eighth: float, highest: float, duration: float, key: str) -> int:
    """Return how many intervals the spline of a signal needs.

    Its error is h^4 / 384 times the fourth derivative: that of a tone whose frequency to the eighth is the mean over
    the signal's power, `eighth` over `square`. highest: its highest frequency [Hz].
    """
    rate = float(max(KNOTS_A_PERIOD * (eighth / square) ** 0.125, _FEWEST_A_PERIOD * highest))
    if not rate * duration < MOST_KNOTS:
        raise SceneError(
            f"{key}: given {duration:g} s of up to {highest:g} Hz, which take {rate * duration:.3g} rows of the drive "
            f"table; allowed: {MOST_KNOTS}; lower or shorter"
        )
    return max(8, math.ceil(rate * duration))


def _require_density(values: Array, rate: float, powers: Array, asked: tuple[int, float, float], key: str) -> None:
    """Raise NumericalFailure where Welch's estimate of values (n,) misses the density asked for by more than chance.

    rate [Hz]; powers (lines,) [U^2] at multiples of rate / length; asked: length, lowest and highest frequency [Hz].
    Compared are bands of the estimate with what the powers lead to expect of it, window and leakage included; their
    ratio is distributed as chi squared over its degrees of freedom, taken as those of half the samples.
    """
    from scipy.fft import irfft, rfft
    from scipy.signal import correlate, welch
    from scipy.signal.windows import blackmanharris
    from scipy.stats import chi2

    length, low, high = asked
    size = min(len(values), math.ceil(_SEGMENT * rate / low))
    window = blackmanharris(size, sym=False)
    frequency, found = welch(values, rate, window, detrend=False)
    covariance = irfft(powers, length)[:size] * (0.5 * length)
    lags = covariance * correlate(window, window, method="fft")[size - 1 :]
    expected = (2.0 * rfft(lags).real - lags[0]) * 2.0 / (rate * np.sum(window**2))
    spacing = rate / length
    raw = np.interp(frequency, spacing * np.arange(len(powers)), powers / spacing, right=0.0)
    band = np.digitize(frequency, np.geomspace(low, high, _BANDS + 1))
    for number in range(1, _BANDS + 1):
        kept = (band == number) & (raw > 0.5 * expected)  # where the window's leakage does not prevail
        if not kept.any():
            continue
        total = float(np.sum(expected[kept]))
        freedom = len(values) / size * total**2 / float(np.sum(expected[kept] ** 2))
        ratio = float(np.sum(found[kept])) / total
        least, most = chi2.interval(1.0 - _CHANCE, freedom) / np.array(freedom)
        if not least * (1.0 - _BY_SPLINE) <= ratio <= most * (1.0 + _BY_SPLINE):
            raise NumericalFailure(
                f"{key}: the realisation has {ratio:.3g} of the power asked for from {frequency[kept][0]:.4g} to "
                f"{frequency[kept][-1]:.4g} Hz; chance gives {least:.3g} to {most:.3g}"
            )
