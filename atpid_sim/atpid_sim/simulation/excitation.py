# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a scene's excitation to the rows of the drive table."""

import math
from collections.abc import Sequence
from functools import singledispatch
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.scene import FreeExcitation, HarmonicExcitation, Scene, SceneError, SeriesExcitation, SweepExcitation
from atpid_sim.scene.excitation import RandomExcitation, ShockExcitation, TonesExcitation
from atpid_sim.scene.series import read_series
from atpid_sim.simulation import signals
from atpid_sim.simulation.signals import KNOTS_A_PERIOD, MOST_KNOTS
from atpid_sim.system import Array

#: Beside the scene's seed: the random stream of the support's motion; sensors and their faults have others.
_STREAM = 9
#: Of a tone that is commanded and does not turn: it stands still within any run [Hz].
_LEAST_FREQUENCY = 1e-6


def support_rows(scene: Scene) -> Array:
    """Return the drive rows (n, 12) of the support's motion over the scene's duration, ceiling left at zero."""
    return _rows(scene.excitation, scene)


@singledispatch
def _rows(excitation: object, _scene: Scene) -> Array:
    """Return the rows of one kind of excitation; each kind is registered with its own."""
    raise TypeError(f"no rows are made of {type(excitation).__name__}")


@_rows.register
def _still_rows(_excitation: FreeExcitation, scene: Scene) -> Array:
    return drive.still_rows(scene.duration)


@_rows.register
def _harmonic_rows(excitation: HarmonicExcitation, scene: Scene) -> Array:
    if scene.frequency_moves:
        return _moving_rows(scene)
    return drive.harmonic_rows(excitation.amplitude_points, scene.frequency_hz, scene.duration)


@_rows.register
def _series_rows(excitation: SeriesExcitation, scene: Scene) -> Array:
    from scipy.interpolate import CubicSpline  # here, since most runs need no part of scipy, which loads slowly

    times, values = read_series(excitation.series, scene.duration)
    rows = drive.spline_rows(times, CubicSpline(times, values).c, scene.duration)
    rows[-1, columns.END] = min(rows[-1, columns.END], scene.duration)
    return rows


@_rows.register
def _tones_rows(excitation: TonesExcitation, scene: Scene) -> Array:
    own = scene.natural_frequency_hz
    tones = [
        (tone.amplitude, own if isinstance(tone.frequency, str) else tone.frequency, tone.phase)
        for tone in excitation.tones
    ]
    return signals.tone_rows(tones, scene.duration, "excitation.tones")


@_rows.register
def _random_rows(excitation: RandomExcitation, scene: Scene) -> Array:
    """Return the rows of a random motion; what is compared with its density is what that is of."""
    random = excitation.random
    seed, rise = scene.seed if random.seed is None else random.seed, random.rise_in(scene.duration)
    density, derivative = random.displacement_psd, 0 if random.unit == "m^2/Hz" else 2
    return signals.random_rows(density, scene.duration, rise, (seed, _STREAM), "excitation.random", derivative)


@_rows.register
def _shock_rows(excitation: ShockExcitation, scene: Scene) -> Array:
    own, shock = scene.natural_frequency_hz, excitation.shock
    return signals.pulse_rows(
        shock.peak_of(own), shock.duration, shock.at, shock.compensation_of(own), scene.duration, "excitation.shock"
    )


@_rows.register
def _sweep_rows(excitation: SweepExcitation, scene: Scene) -> Array:
    sweep = excitation.sweep
    full = sweep.duration or scene.duration
    length = min(full, scene.duration)
    last = sweep.first + (sweep.last - sweep.first) * length / full
    pieces = [_Piece(0.0, length, (sweep.first, last), (sweep.amplitude, sweep.amplitude))]
    if length < scene.duration:
        pieces.append(_Piece(length, scene.duration, (last, last), (sweep.amplitude, sweep.amplitude)))
    return _joined(pieces, "excitation.sweep")


class CommandedMotion:
    """A tone that is commanded while it runs: amplitude and frequency go straight from block to block.

    Its phase has no jump; without a command the support is at rest.
    """

    def __init__(self) -> None:
        """Begin at rest."""
        self.amplitude = self.frequency = 0.0  # at the end of the last block [m] or [N], [Hz]
        self.goal = (0.0, 0.0)  # amplitude and frequency at the end of the next block
        self._turns = 0.0

    def rows(self, begin: float, end: float) -> Array:
        """Return the rows (n, 12) of the block from `begin` to `end` [s]."""
        before, (amplitude, frequency) = (self.amplitude, self.frequency), self.goal
        if not amplitude:
            frequency = before[1]  # it fades at the frequency it has
        first = before[1] if before[0] else frequency
        self.amplitude, self.frequency = amplitude, frequency
        if not (before[0] or amplitude):
            rows = drive.still_rows(end)
            rows[0, columns.START] = begin
            return rows
        ends = max(first, _LEAST_FREQUENCY), max(frequency, _LEAST_FREQUENCY)
        piece = _Piece(begin, end, ends, (before[0], amplitude))
        rows = piece.rows(self._turns, "excitation/state")
        rows[0, columns.START], rows[-1, columns.END] = begin, end
        self._turns = math.fmod(self._turns + piece.turns, 1.0)
        return rows


def frequency_points(scene: Scene) -> list[tuple[float, float]]:
    """Return ((t [s], f [Hz]), ...) of a tone: one point where the frequency is constant."""
    return list(scene.excitation.frequency_points) or [(0.0, scene.frequency_hz)]


def amplitude_at(scene: Scene, t: float) -> float:
    """Return the excitation's amplitude at time t [s] in m; NaN where it has no one amplitude."""
    return _along(scene.excitation.amplitude_points, t)


def steady_amplitude(scene: Scene) -> float:
    """Return a tone's amplitude in the middle of the steady window [m or N]; raise SceneError for another drive."""
    if not scene.excitation.is_tone:
        raise SceneError(
            f"excitation: given a {scene.excitation.kind} one; a height is selected for a tone {{amplitude, frequency}}"
        )
    begin, end = scene.steady_window
    return amplitude_at(scene, 0.5 * (begin + end))


def frequency_at(scene: Scene, t: float) -> float:
    """Return the excitation's frequency at time t [s] in Hz; NaN where it has no one frequency."""
    excitation = scene.excitation
    if isinstance(excitation, HarmonicExcitation | FreeExcitation):
        return _along(frequency_points(scene), t)
    if not isinstance(excitation, SweepExcitation):
        return math.nan
    sweep = excitation.sweep
    share = min(1.0, t / (sweep.duration or scene.duration))
    return sweep.first + (sweep.last - sweep.first) * share


def _along(points: Sequence[tuple[float, float]], t: float) -> float:
    """Return the value at time t [s] along straight ramps between points."""
    return float(np.interp(t, [at for at, _ in points], [value for _, value in points]))


def _moving_rows(scene: Scene) -> Array:
    """Return the rows of a tone whose frequency moves along straight ramps, its phase without a jump."""
    amplitudes, frequencies = scene.excitation.amplitude_points, frequency_points(scene)
    kinks = {t for t, _ in (*amplitudes, *frequencies) if 0.0 < t < scene.duration}
    pieces = []
    for begin, end in pairwise(sorted({0.0, scene.duration, *kinks})):
        tones, sizes = ((_along(points, begin), _along(points, end)) for points in (frequencies, amplitudes))
        pieces.append(_Piece(begin, end, tones, sizes))
    return _joined(pieces, "excitation.frequency")


class _Piece(NamedTuple):
    """A tone whose amplitude and frequency change at constant rates."""

    begin: float  # [s]
    end: float  # [s]
    frequency: tuple[float, float]  # at its ends [Hz]
    amplitude: tuple[float, float]  # at its ends [m]

    @property
    def turns(self) -> float:
        """Periods from its begin to its end."""
        return 0.5 * (self.frequency[0] + self.frequency[1]) * (self.end - self.begin)

    def rows(self, turns: float, key: str) -> Array:
        """Return its rows (n, 12); turns: of the tone before it, less whole ones. SceneError names `key`."""
        if self.frequency[0] != self.frequency[1]:
            return self._chirp(turns, key)
        length = self.end - self.begin
        rows = drive.harmonic_rows([(0.0, self.amplitude[0]), (length, self.amplitude[1])], self.frequency[0], length)
        rows[:, columns.PHASE] += 2.0 * math.pi * turns
        rows[:, [columns.START, columns.END]] += self.begin
        return rows

    def _chirp(self, before: float, key: str) -> Array:
        """Return the rows of a spline through points of the tone, with its velocity at both ends."""
        from scipy.interpolate import CubicSpline

        length, first = self.end - self.begin, self.frequency[0]
        rise = (self.frequency[1] - first) / length
        growth = (self.amplitude[1] - self.amplitude[0]) / length
        times = _knots(first, rise, length, key)
        turns = np.mod(before + first * times + 0.5 * rise * times**2, 1.0)
        size = self.amplitude[0] + growth * times
        values = size * np.sin(2.0 * math.pi * turns)
        rate = 2.0 * math.pi * (first + rise * times[[0, -1]])
        phase = 2.0 * math.pi * turns[[0, -1]]
        slopes = size[[0, -1]] * rate * np.cos(phase) + growth * np.sin(phase)
        spline = CubicSpline(times, values, bc_type=((1, slopes[0]), (1, slopes[1])))
        return drive.spline_rows(times + self.begin, spline.c, self.end)


def _joined(pieces: list[_Piece], key: str) -> Array:
    """Return the rows of pieces that follow each other, the phase without a jump and each row where the last ended."""
    tables, turns = [], 0.0
    for piece in pieces:
        rows = piece.rows(turns, key)
        rows[0, columns.START], rows[-1, columns.END] = piece.begin, piece.end
        tables.append(rows)
        turns = math.fmod(turns + piece.turns, 1.0)
    return np.vstack(tables)


def _knots(first: float, rise: float, length: float, key: str) -> Array:
    """Return times (n,) [s] from 0 to `length`, 200 in each period of the frequency first + rise t [Hz].

    The fourth derivative of sin(phase) is at most (w^2 + 3 |w'|)^2 with w = phase'. So knots as for a frequency higher
    by the root of 3 |w'| / (2 pi)^2 keep the spline's error also where the frequency changes within a period.
    """
    first += math.sqrt(3.0 * abs(rise) / (2.0 * math.pi))
    periods = length * (first + 0.5 * rise * length)
    if periods * KNOTS_A_PERIOD > MOST_KNOTS:
        raise SceneError(
            f"{key}: given {periods:.0f} periods in {length:g} s; allowed: {MOST_KNOTS // KNOTS_A_PERIOD} "
            f"periods ({MOST_KNOTS} rows of the drive table); lower or shorter, or in parts"
        )
    share = np.linspace(0.0, periods, max(2, math.ceil(KNOTS_A_PERIOD * periods)) + 1)
    times = 2.0 * share / (first + np.sqrt(np.maximum(first**2 + 2.0 * rise * share, 0.0)))
    times[-1] = length
    return times
