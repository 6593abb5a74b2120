# SPDX-License-Identifier: Apache-2.0
"""From a scene's excitation to the rows of the drive table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from atpid_sim.engine import drive
from atpid_sim.scene import FreeExcitation, HarmonicExcitation, Scene, SceneError, SeriesExcitation

Array = NDArray[np.float64]

#: Knots a period of a sweep: the cubic spline is then within 2.5e-9 of the amplitude ((2 pi / 200)^4 / 384).
_KNOTS_A_PERIOD = 200


def support_rows(scene: Scene) -> Array:
    """Return the drive rows (n, 12) of the support's motion over the scene's duration, ceiling left at zero."""
    excitation, duration = scene.excitation, scene.duration
    if isinstance(excitation, HarmonicExcitation):
        return drive.harmonic_rows(amplitude_points(scene), scene.frequency_hz, duration)
    if isinstance(excitation, FreeExcitation):
        return drive.still_rows(duration)
    if isinstance(excitation, SeriesExcitation):
        return _series_rows(scene)
    return _sweep_rows(scene)


def amplitude_points(scene: Scene) -> list[tuple[float, float]]:
    """Return ((t [s], A [m]), ...) of a tone: one point where the amplitude is constant."""
    amplitude = getattr(scene.excitation, "amplitude", 0.0)
    return (
        [(0.0, float(amplitude))]
        if isinstance(amplitude, int | float)
        else [(float(t), float(a)) for t, a in amplitude]
    )


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


def reading(scene: Scene) -> str:
    """Return in words what drives the beam."""
    if isinstance(scene.excitation, FreeExcitation):
        return f"release from {scene.excitation.free.deflection:g} m"
    return f"{scene.excitation.kind} excitation"


def _sweep_rows(scene: Scene) -> Array:
    sweep = scene.excitation.sweep  # type: ignore[union-attr]
    length = min(sweep.duration or scene.duration, scene.duration)
    full = sweep.duration or scene.duration
    rise = (sweep.last - sweep.first) / full
    count = max(2, math.ceil(_KNOTS_A_PERIOD * length * max(sweep.first, sweep.last)))
    times = np.linspace(0.0, length, count + 1)
    phase = 2.0 * math.pi * (sweep.first * times + 0.5 * rise * times**2)
    rate = 2.0 * math.pi * (sweep.first + rise * times[[0, -1]])
    slopes = sweep.amplitude * rate * np.cos(phase[[0, -1]])
    spline = CubicSpline(times, sweep.amplitude * np.sin(phase), bc_type=((1, slopes[0]), (1, slopes[1])))
    rows = drive.spline_rows(times, spline.c, scene.duration)
    if length >= scene.duration:
        return rows
    tail = drive.harmonic_rows([(0.0, sweep.amplitude)], sweep.last, scene.duration - length)
    tail[:, drive.PHASE] += math.fmod(phase[-1], 2.0 * math.pi)
    tail[:, [drive.START, drive.END]] += length
    return np.vstack([rows, tail])


def _series_rows(scene: Scene) -> Array:
    times, values = read_series(scene)
    spline = CubicSpline(times, values)
    rows = drive.spline_rows(times, spline.c, scene.duration)
    rows[-1, drive.END] = min(rows[-1, drive.END], scene.duration)
    return rows


def read_series(scene: Scene) -> tuple[Array, Array]:
    """Return times from 0 (n,) [s] and support displacements (n,) [m] of a measured series.

    Raises SceneError where the file lacks a column, holds NaN or unordered times, or is shorter than the scene.
    """
    series = scene.excitation.series  # type: ignore[union-attr]
    names = (series.time, series.displacement)
    table = _read_npz(series.file) if series.file.suffix.lower() == ".npz" else _read_csv(series.file)
    have = list(table)
    for name in names:
        if name not in have:
            raise SceneError(f"{series.file}: no column '{name}'; it has {', '.join(have)}")
    times, values = (np.asarray(table[name], dtype=np.float64) for name in names)
    if len(times) < 4 or not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise SceneError(
            f"{series.file}: needs at least 4 finite samples with rising times; cut or repair the gaps first"
        )
    times = times - times[0]
    if times[-1] < scene.duration * (1.0 - 1e-9):
        raise SceneError(f"{series.file}: lasts {times[-1]:g} s, the scene {scene.duration:g} s; shorten the duration")
    return times, values


def _read_npz(path: Path) -> dict[str, Array]:
    with np.load(path) as arrays:
        return {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays.files}


def _read_csv(path: Path) -> dict[str, Array]:
    names = path.read_text(encoding="utf-8").partition("\n")[0].replace(" ", "").split(",")
    columns = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2, dtype=np.float64)
    return dict(zip(names, columns.T, strict=True))
