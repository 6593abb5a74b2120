# SPDX-License-Identifier: Apache-2.0
"""From a scene's excitation to the rows of the drive table."""

import math

import numpy as np
from scipy.interpolate import CubicSpline

from atpid_sim.engine import columns, drive
from atpid_sim.scene import FreeExcitation, HarmonicExcitation, Scene, SceneError, SeriesExcitation
from atpid_sim.scene.excitation import Sweep
from atpid_sim.scene.series import read_series
from atpid_sim.system import Array

#: Knots a period of a sweep: the cubic spline is then within 2.5e-9 of the amplitude ((2 pi / 200)^4 / 384).
_KNOTS_A_PERIOD = 200
#: Knots of a sweep at most: their table and what is computed from it fill 2 GB.
_MOST_KNOTS = 5_000_000


def support_rows(scene: Scene) -> Array:
    """Return the drive rows (n, 12) of the support's motion over the scene's duration, ceiling left at zero."""
    excitation, duration = scene.excitation, scene.duration
    if isinstance(excitation, HarmonicExcitation):
        return drive.harmonic_rows(amplitude_points(scene), scene.frequency_hz, duration)
    if isinstance(excitation, FreeExcitation):
        return drive.still_rows(duration)
    if isinstance(excitation, SeriesExcitation):
        times, values = read_series(excitation.series, duration)
        rows = drive.spline_rows(times, CubicSpline(times, values).c, duration)
        rows[-1, columns.END] = min(rows[-1, columns.END], duration)
        return rows
    return _sweep_rows(scene, excitation.sweep)


def amplitude_points(scene: Scene) -> list[tuple[float, float]]:
    """Return ((t [s], A [m]), ...) of a tone: one point where the amplitude is constant."""
    amplitude = getattr(scene.excitation, "amplitude", 0.0)
    points = [(0.0, amplitude)] if isinstance(amplitude, int | float) else amplitude
    return [(float(t), float(a)) for t, a in points]


def amplitude_at(scene: Scene, t: float) -> float:
    """Return the excitation's amplitude at time t [s] in m; NaN for a measured series."""
    excitation = scene.excitation
    if isinstance(excitation, HarmonicExcitation):
        points = amplitude_points(scene)
        return float(np.interp(t, [at for at, _ in points], [a for _, a in points]))
    if isinstance(excitation, FreeExcitation):
        return 0.0
    return math.nan if isinstance(excitation, SeriesExcitation) else excitation.sweep.amplitude


def frequency_at(scene: Scene, t: float) -> float:
    """Return the excitation's frequency at time t [s] in Hz; NaN for a measured series."""
    excitation = scene.excitation
    if isinstance(excitation, HarmonicExcitation | FreeExcitation):
        return scene.frequency_hz
    if isinstance(excitation, SeriesExcitation):
        return math.nan
    sweep = excitation.sweep
    share = min(1.0, t / (sweep.duration or scene.duration))
    return sweep.first + (sweep.last - sweep.first) * share


def _sweep_rows(scene: Scene, sweep: Sweep) -> Array:
    full = sweep.duration or scene.duration
    length = min(full, scene.duration)
    rise = (sweep.last - sweep.first) / full
    times = _sweep_knots(sweep.first, rise, length)
    turns = np.mod(sweep.first * times + 0.5 * rise * times**2, 1.0)
    values = sweep.amplitude * np.sin(2.0 * math.pi * turns)
    rate = 2.0 * math.pi * (sweep.first + rise * times[[0, -1]])
    slopes = sweep.amplitude * rate * np.cos(2.0 * math.pi * turns[[0, -1]])
    spline = CubicSpline(times, values, bc_type=((1, slopes[0]), (1, slopes[1])))
    rows = drive.spline_rows(times, spline.c, scene.duration)
    if length >= scene.duration:
        return rows
    tail = drive.harmonic_rows([(0.0, sweep.amplitude)], sweep.last, scene.duration - length)
    tail[:, columns.PHASE] += 2.0 * math.pi * turns[-1]
    tail[:, [columns.START, columns.END]] += length
    return np.vstack([rows, tail])


def _sweep_knots(first: float, rise: float, length: float) -> Array:
    """Return times (n,) [s] from 0 to `length`, 200 in each period of the frequency first + rise t [Hz].

    The fourth derivative of sin(phase) is at most (w^2 + 3 |w'|)^2 with w = phase'. So knots as for a frequency higher
    by the root of 3 |w'| / (2 pi)^2 keep the spline's error also where the frequency changes within a period.
    """
    first += math.sqrt(3.0 * abs(rise) / (2.0 * math.pi))
    periods = length * (first + 0.5 * rise * length)
    if periods * _KNOTS_A_PERIOD > _MOST_KNOTS:
        raise SceneError(
            f"excitation.sweep: given {periods:.0f} periods in {length:g} s; allowed: {_MOST_KNOTS // _KNOTS_A_PERIOD} "
            f"periods ({_MOST_KNOTS} rows of the drive table); sweep lower or shorter, or in parts"
        )
    share = np.linspace(0.0, periods, max(2, math.ceil(_KNOTS_A_PERIOD * periods)) + 1)
    times = 2.0 * share / (first + np.sqrt(np.maximum(first**2 + 2.0 * rise * share, 0.0)))
    times[-1] = length
    return times
