# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers over time, bounded; blocks of samples thinned for the screen; the spectrum of the last seconds."""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from atpid_sim.simulation.quantities import amplitude_spectrum
from atpid_sim.system import Array

Row = tuple[float | None, ...]
#: Digits after the point that are sent: 1 ns, 1 nm, 1 nHz.
_DIGITS = 9


def plain(value: float) -> float | None:
    """Return a number as JSON can hold it: rounded; None for NaN and infinity."""
    return round(float(value), _DIGITS) if math.isfinite(value) else None


class Rows:
    """Rows (time [s], values...) in the order they came, one in `spacing` [s] at most; a row of None is a gap."""

    def __init__(self, kept: int, spacing: float = 0.0, longest: float = math.inf) -> None:
        """Keep the last `kept` rows; leave out those that follow the one before by less than `spacing` [s].

        More than `longest` [s] between two rows is a gap.
        """
        self._longest = longest
        self._rows: deque[Row] = deque(maxlen=kept)
        self._new: deque[Row] = deque(maxlen=kept)
        self._spacing, self._last = spacing, -math.inf

    def add(self, time: float, *values: float) -> None:
        """Add a row, where it is due."""
        if time < self._last + self._spacing:
            return
        if time > self._last + self._longest:
            self.add_gap(self._last + self._longest)
        self._last = time
        self._append((plain(time), *map(plain, values)))

    def add_gap(self, time: float) -> None:
        """Draw no line over this time [s], which lies between the last row and the next."""
        if self._rows:
            self._append((plain(time), *(None for _ in self._rows[-1][1:])))

    def _append(self, row: Row) -> None:
        self._rows.append(row)
        self._new.append(row)

    def all(self) -> Sequence[Row]:
        """Return all rows that are kept, sent or not."""
        return list(self._rows)

    def take(self) -> Sequence[Row]:
        """Return the rows that came since the last call."""
        taken = list(self._new)
        self._new.clear()
        return taken

    def clear(self) -> None:
        """Forget everything."""
        self._rows.clear()
        self._new.clear()
        self._last = -math.inf


#: Scans a second for the screen [Hz].
RATE = 1000.0
#: The spectrum: length of its window [s], harmonics of the excitation and most lines that are shown.
WINDOW, HARMONICS, LINES = 4.0, 8, 500
#: Share of samples that may be missing in the window, and by which a stream's rate may change [-].
_MISSING, _SAME = 0.1, 0.01


def thinned(first_index: int, rate: float, values: Array) -> tuple[Array, Array]:
    """Return times (m,) after the stream's first scan [s], and values (m, k), of a block of samples (n, k).

    All scans up to `RATE`. Of a faster stream those with the least and the largest value of each channel in each
    interval, which a block may end in the middle of: no amplitude is lost. NaN are left out, but where there is
    nothing else in the interval.
    """
    index = first_index + np.arange(len(values))
    if rate > RATE:
        interval = index // math.ceil(2 * values.shape[1] * rate / RATE)
        begins = np.flatnonzero(np.diff(interval, prepend=-1))
        extremes = [np.lexsort((side, interval))[begins] for column in values.T for side in (column, -column)]
        chosen = np.unique(extremes)  # NaN are sorted last
        index, values = index[chosen], values[chosen]
    return index / rate, values


class LastSamples:
    """The samples (n, k) of the last `WINDOW`; NaN: lost."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.values, self.rate, self._next = np.empty((0, 0)), math.nan, 0

    def add(self, first_index: int, rate: float, values: Array) -> None:
        """Take a block of samples (n, k) at a rate [Hz]; one of another rate begins again."""
        if not abs(rate - self.rate) <= _SAME * self.rate:
            self.values, self.rate, self._next = values[:0], rate, first_index
        lost = min(max(first_index - self._next, 0), self._kept)
        gap = np.full((lost, values.shape[1]), np.nan)
        self.values = np.concatenate([self.values, gap, values])[-self._kept :]
        self._next = first_index + len(values)

    @property
    def _kept(self) -> int:
        return max(1, round(WINDOW * self.rate))

    def spectra(self, frequency: float) -> tuple[Array, list[Array | None]] | None:
        """Return frequencies (m,) [Hz] and each channel's amplitudes (m,), None where too much is missing.

        frequency: of the excitation [Hz], NaN: not known. None before the window is full.
        """
        if math.isnan(self.rate) or len(self.values) < self._kept:
            return None
        frequencies = np.empty(0)
        channels: list[Array | None] = []
        for values in self.values.T:
            found = spectrum(values, self.rate, highest(frequency, self.rate))
            frequencies = frequencies if found is None else found[0]
            channels.append(None if found is None else found[1])
        return (frequencies, channels) if len(frequencies) else None


def highest(frequency: float, rate: float) -> float:
    """Return the end of the spectrum's axis [Hz]: `HARMONICS` of the excitation at least, so that it moves rarely.

    It is 1, 2 or 5 times a power of ten, half the sampling rate at most, and that where the excitation is unknown.
    """
    if not frequency > 0.0:
        return 0.5 * rate
    decade = 10.0 ** math.floor(math.log10(HARMONICS * frequency))
    return float(min(0.5 * rate, next(k * decade for k in (1, 2, 5, 10) if k * decade >= HARMONICS * frequency)))


def spectrum(values: Array, rate: float, end: float) -> tuple[Array, Array] | None:
    """Return frequencies (m,) [Hz] up to `end` [Hz] and amplitudes (m,) of `values` (n,) at a rate [Hz].

    With a Hann window: a tone has its own amplitude, whatever its phase. Of more than `LINES` lines each that is
    shown is the largest of its neighbours. None where too much is missing.
    """
    valid = np.isfinite(values)
    if valid.sum() < (1.0 - _MISSING) * len(values):
        return None
    index = np.arange(len(values))
    signal = np.interp(index, index[valid], values[valid])
    weighted = 2.0 * np.hanning(len(signal) + 1)[:-1] * (signal - signal.mean())
    frequencies, amplitudes = amplitude_spectrum(weighted, rate)
    count = int(np.searchsorted(frequencies, end, side="right"))
    step = math.ceil(count / LINES)
    middles = np.minimum(np.arange(0, count, step) + step // 2, count - 1)
    return frequencies[middles], np.maximum.reduceat(amplitudes[:count], np.arange(0, count, step))
