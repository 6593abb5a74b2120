# SPDX-License-Identifier: Apache-2.0
"""Blocks of samples thinned for the screen, and the spectrum of the last seconds."""

from collections.abc import Sequence

import numpy as np

from atpid_sim.analysis import amplitude_spectrum
from atpid_sim.system import Array

#: Rows a second on the screen [Hz]; 8 s of them are kept.
RATE, KEPT = 200.0, 1600
#: The spectrum: length of its window [s], highest frequency shown [Hz], lines left out between two that are sent.
WINDOW, HIGHEST, EVERY = 4.0, 40.0, 2
#: Share of samples that may be missing in the window [-].
_MISSING = 0.1
#: Rows in the window, at least.
_FEWEST = 16


def thinned(first_index: int, rate: float, values: Array) -> tuple[Array, Array]:
    """Return times (m,) after the stream's first scan [s], and means (m, k), of a block of samples (n, k).

    Each is the mean of the scans of one interval of 1/`RATE`, which a block may end in the middle of; it stands at
    their mean time. NaN are left out; a mean of nothing but NaN is NaN.
    """
    count = len(values)
    step = max(1, round(rate / RATE))
    index = first_index + np.arange(count)
    cuts = np.flatnonzero(np.diff(index // step, prepend=-1))
    lengths = np.diff(cuts, append=count)
    valid = np.isfinite(values)
    sums = np.add.reduceat(np.where(valid, values, 0.0), cuts, axis=0)
    numbers = np.add.reduceat(valid.astype(float), cuts, axis=0)
    means = np.divide(sums, numbers, out=np.full_like(sums, np.nan), where=numbers > 0.0)
    return (index[cuts] + 0.5 * (lengths - 1)) / rate, means


def spectrum(times: Array, values: Array) -> tuple[Array, Array] | None:
    """Return frequencies (m,) [Hz] and amplitudes (m,) of the last `WINDOW` of `values` (n,) at `times` (n,) [s].

    With a Hann window: a tone has its own amplitude, whatever its phase. None where too much is missing.
    """
    if len(times) < 2 or times[-1] - times[0] < WINDOW:
        return None
    inside = times > times[-1] - WINDOW
    valid = inside & np.isfinite(values)
    if inside.sum() < _FEWEST or valid.sum() < (1.0 - _MISSING) * WINDOW * RATE * _share(times[inside]):
        return None
    even = np.linspace(times[-1] - WINDOW, times[-1], round(WINDOW * RATE), endpoint=False)
    signal = np.interp(even, times[valid], values[valid])
    weighted = 2.0 * np.hanning(len(signal) + 1)[:-1] * (signal - signal.mean())
    frequencies, amplitudes = amplitude_spectrum(weighted, RATE)
    shown = slice(None, int(np.searchsorted(frequencies, HIGHEST)) + 1, EVERY)
    return frequencies[shown], amplitudes[shown]


def _share(times: Array) -> float:
    """Return how many of the rows of `RATE` a stream gives that is sampled more slowly [-]."""
    return min(1.0, 1.0 / (RATE * float(np.median(np.diff(times)))))


def columns(rows: Sequence[tuple[float | None, ...]]) -> Array:
    """Return rows (n, k) as an array; None as NaN."""
    return np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=float)
