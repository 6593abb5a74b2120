# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Orders: amplitude and phase at multiples of the excitation's frequency, by least squares, and the distortion."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_control.analysis.signals import AnalysisError, Signals, runs
from atpid_sim.system import Array

_Places = NDArray[np.intp]
#: Periods that the fit needs; change of amplitude within the part from which it is named [-].
FEWEST, _CHANGE = 5.0, 0.05
#: Periods of a window in which the excitation's amplitude is followed, and by how much it may differ [-].
_WINDOW, _SAME = 6.0, 0.02
#: Share of the largest amplitude below which the excitation is off [-].
_OFF = 0.05
#: Change of the excitation's frequency from half to half, times the duration, from which it is named [-]: order 1 then
#: loses 0.1 % of its amplitude, order 6 4 %.
_DRIFT = 0.1
#: Steps to the frequency of a tone, at most; of a clear one four do.
_STEPS = 20
#: Samples fitted at once.
_PIECE = 1 << 16
#: Parts in which the residual is summed beside each order, and lines on either side of it that give its density.
_PARTS, _LINES = 64, 8
#: Student's 95 % quantile is that of the normal distribution times 1 + this over the degrees of freedom.
_STUDENT = 1.21


@dataclass(frozen=True)
class Orders:
    """The response at k times the excitation's frequency, k = 1, 2, ...: sum of amplitude sin(k omega t + phase)."""

    begin: float  # of the part [s]
    end: float  # [s]
    frequency: float  # of the excitation [Hz]
    excitation: float  # its amplitude
    amplitude: Array  # (k,)
    amplitude_std: Array  # (k,) by the residual's density beside each order
    phase: Array  # (k,) after k times the excitation's phase [rad], in (-pi, pi]
    residual: float  # root mean square of what the orders leave
    doubts: tuple[str, ...]

    @property
    def distortion(self) -> float:
        """Total harmonic distortion: root of the power of orders 2, 3, ... over the first [-]."""
        return float(np.sqrt(np.sum(self.amplitude[1:] ** 2)) / self.amplitude[0])

    @property
    def excitation_ratio(self) -> float:
        """Amplitude of the first order over the excitation's [-]."""
        return float(self.amplitude[0]) / self.excitation


def orders(signals: Signals, count: int = 6) -> Orders:
    """Return orders 1 to `count` of the response, and the excitation's tone. Raises AnalysisError."""
    frequency = tone_of(signals.excitation, signals.rate)
    count = min(count, int(0.45 * signals.rate / frequency))
    if signals.duration * frequency < FEWEST or count < 1:
        raise AnalysisError(f"{signals.duration * frequency:.2g} periods of the excitation; needed: {FEWEST:g}")
    time = np.arange(len(signals.response)) / signals.rate
    given, _, _, _ = _fit(time, signals.excitation, frequency, 1)
    found, residual, used, offset = _fit(time, signals.response, frequency, count)
    if not abs(given[0]) > 0.0 or not abs(found[0]) > 0.0:
        advice = "choose it with --from and --to"
        raise AnalysisError(f"no excitation: nothing moves at one frequency in this part; {advice}")
    turns = np.angle(given[0]) + 2.0 * math.pi * frequency * signals.delay
    turned = found * np.exp(-1j * turns * np.arange(1, count + 1))
    parts = slice(0, len(time) // 2), slice(len(time) // 2, len(time))
    halves = [_fit(time[part], signals.response[part], frequency, 1)[0][0] for part in parts]
    change = abs(abs(halves[1]) / abs(halves[0]) - 1.0) if abs(halves[0]) > 0.0 else math.inf
    errors = np.maximum(_errors(time, signals.response - offset, frequency, found), residual * math.sqrt(2.0 / used))
    doubts = (*_drift(signals, parts), *_doubts(change, residual, abs(found[0])))
    span, tone = (signals.start, signals.start + float(time[-1])), (frequency, abs(given[0]))
    return Orders(*span, *tone, np.abs(found), errors, np.angle(turned), residual, doubts)


def steady_part(signals: Signals) -> Signals:
    """Return the second half of the last part in which the excitation's amplitude is constant. Raises AnalysisError."""
    frequency = tone_of(signals.excitation, signals.rate)
    size = math.ceil(_WINDOW * signals.rate / frequency)
    time = np.arange(size) / signals.rate
    count = len(signals.excitation) // size
    before = len(signals.excitation) - count * size  # the last window ends with the record
    found = np.full(count, np.nan)
    for place in range(count):
        part = signals.excitation[before + place * size : before + (place + 1) * size]
        if np.isfinite(part).mean() > 0.5:
            found[place] = abs(_fit(time, part, frequency, 1)[0][0])
    on = np.flatnonzero(found > _OFF * np.nanmax(found)) if np.isfinite(found).any() else np.array([], dtype=int)
    if not len(on):
        return signals
    last = int(on[-1])
    # the last window may hold the end of the excitation
    last -= int(last > on[0] and abs(found[last] / found[last - 1] - 1.0) > _SAME)
    first = last
    while first > 0 and abs(found[first - 1] / found[last] - 1.0) <= _SAME:
        first -= 1
    half = ((last + 1 - first) * size) // 2 if last > first else 0
    ends = before + first * size + half, before + (last + 1) * size - 1
    return signals.between(*(signals.start + end / signals.rate for end in ends))


def tone_of(values: Array, rate: float) -> float:
    """Return the frequency of the strongest tone of a signal (n,), by least squares [Hz]. Raises AnalysisError."""
    begin, end = max(runs(np.isfinite(values)), key=lambda part: part[1] - part[0], default=(0, 0))
    part = values[begin:end] - (values[begin:end].mean() if end > begin else 0.0)
    if len(part) < 16 or not float(np.abs(part).max()) > 0.0:
        raise AnalysisError("no excitation: the signal that should excite is constant; choose another with --input")
    lines = np.abs(np.fft.rfft(part * np.hanning(len(part))))
    place = int(np.argmax(lines[1:])) + 1
    above = place + 1 < len(lines) and lines[place + 1] > lines[place - 1]
    share = min(1.0, float(lines[place + (1 if above else -1)] / lines[place]))  # a tone lies between two lines
    step, time = 2.0 * math.pi * rate / len(part), (np.arange(len(part)) - 0.5 * len(part)) / rate
    omega = (place + math.copysign(max(0.0, 2.0 * share - 1.0) / (share + 1.0), above - 0.5)) * step
    sine = cosine = 0.0

    def columns(piece: _Places) -> Array:
        turns = omega * time[piece]
        waves = np.sin(turns), np.cos(turns)
        ahead = (sine * waves[1] - cosine * waves[0]) / (math.hypot(sine, cosine) or 1.0)
        return np.column_stack([np.ones(len(turns)), *waves, time[piece] * ahead])

    for _ in range(_STEPS):  # Gauss-Newton; the first time the last column is zero
        (_, sine, cosine, change), _ = _solved(_pieces(np.arange(len(part))), part, columns)
        before, change = omega, change / (math.hypot(sine, cosine) or 1.0)
        omega = min(max(omega + change, max(0.25, place - 1.0) * step), (place + 1.0) * step)
        if 0.0 < abs(omega - before) < 1e-10 * omega:
            break
    return omega / (2.0 * math.pi)


def _fit(time: Array, values: Array, frequency: float, count: int) -> tuple[Array, float, int, float]:
    """Return amplitude exp(i phase) of each order (count,), the residual's root mean square, samples used, and offset.

    By normal equations, since sines and cosines over some periods are nearly orthogonal; piece by piece, for memory.
    """
    valid = np.flatnonzero(np.isfinite(values))
    pieces = _pieces(valid)

    def columns(piece: _Places) -> Array:
        turns = 2.0 * math.pi * frequency * np.outer(time[piece], np.arange(1, count + 1))
        return np.column_stack([np.ones(len(turns)), np.sin(turns), np.cos(turns)])

    solved, power = _solved(pieces, values, columns)
    used = max(1, len(valid) - 2 * count - 1)
    return solved[1 : 1 + count] + 1j * solved[1 + count :], math.sqrt(power / used), used, float(solved[0])


def _solved(pieces: list[_Places], values: Array, columns: Callable[[_Places], Array]) -> tuple[Array, float]:
    """Return the coefficients of the columns, and the residual's sum of squares."""
    sums = [(made.T @ made, made.T @ values[piece]) for piece in pieces for made in (columns(piece),)]
    gram, joint = (sum(each) for each in zip(*sums, strict=True))
    solved, *_ = np.linalg.lstsq(gram, joint, rcond=None)
    return solved, sum(float(np.sum((values[piece] - columns(piece) @ solved) ** 2)) for piece in pieces)


def _pieces(valid: _Places) -> list[_Places]:
    return [valid[first : first + _PIECE] for first in range(0, len(valid), _PIECE)]


def _errors(time: Array, values: Array, frequency: float, found: Array) -> Array:
    """Return the standard deviation of each order's amplitude (k,), whatever the noise's colour.

    The orders `found` leave of `values` (n,), without offset, what is shifted by each order to frequency zero and
    summed in parts: the mean power of the lines beside zero is the noise's at the order itself, which the fit has taken
    away.
    """
    valid, numbers = np.flatnonzero(np.isfinite(values)), np.arange(1, len(found) + 1)
    sums = np.zeros((len(found), _PARTS), dtype=complex)
    for piece in _pieces(valid):
        waves = np.exp(2j * math.pi * frequency * np.outer(numbers, time[piece]))
        shifted = (values[piece] - np.imag(found @ waves)) * np.conj(waves)
        places = np.minimum(piece * _PARTS // len(time), _PARTS - 1)
        for k, row in enumerate(shifted):
            sums[k].real += np.bincount(places, row.real, _PARTS)
            sums[k].imag += np.bincount(places, row.imag, _PARTS)
    # lines nearer to the next order than to this one are the other's
    lines = int(np.clip(0.5 * frequency * time[-1], 2, _LINES))
    power = np.abs(np.fft.fft(sums, axis=1)) ** 2
    near = 0.5 * (power[:, 1 : lines + 1].mean(axis=1) + power[:, -lines:].mean(axis=1))
    return np.asarray(np.sqrt(2.0 * near) / len(valid) * (1.0 + _STUDENT / (4 * lines)))


def _drift(signals: Signals, parts: tuple[slice, slice]) -> Iterator[str]:
    """Yield that the excitation's frequency changes within the part, where it does."""
    try:
        first, second = (tone_of(signals.excitation[part], signals.rate) for part in parts)
    except AnalysisError:  # a half without a tone of its own: the orders are those of the other
        return
    if abs(second - first) * signals.duration > _DRIFT:
        what = "orders come out too low, the higher the more; choose a shorter part with --from and --to"
        yield f"the excitation's frequency changes from {first:.5g} to {second:.5g} Hz within the part: {what}"


def _doubts(change: float, residual: float, amplitude: float) -> Iterator[str]:
    if change > _CHANGE:
        what = "orders are means over it; choose a steady part with --from and --to"
        yield f"the amplitude changes by {100.0 * change:.2g} % within the part: {what}"
    if residual > 0.1 * amplitude:
        what = "is at no multiple of the excitation: irregular or subharmonic motion, or noise"
        yield f"{100.0 * residual / amplitude:.2g} % of the amplitude {what}"
