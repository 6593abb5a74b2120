# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads a measured series from CSV or NPZ; whatever is wrong with the file is one line that names it."""

import csv
import math
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import FileError, check, read_arrays
from atpid_sim.scene.excitation import Series
from atpid_sim.scene.scene import shown
from atpid_sim.scene.yaml12 import SceneError
from atpid_sim.system import Array

#: Samples below which there is no cubic spline.
_FEWEST = 4
#: Shortest time between two samples [s].
_CLOSEST = 1e-9
#: Largest displacement a support can have [m]: more is another unit.
_FARTHEST = 1e3
#: Size of a file at most [bytes]: several hours at 1 kHz.
_LARGEST_CSV, _LARGEST_NPZ = 250_000_000, 500_000_000
#: What to do with an NPZ file that is none.
_NPZ = "write it with numpy.savez(file, time=..., support_displacement=...)"


def read_series(series: Series, duration: float) -> tuple[Array, Array]:
    """Return times from 0 (n,) [s] and displacements less the offset (n,) [m], for a run of `duration` [s].

    An acceleration is integrated twice (`_integrated`). Raises SceneError where the file lacks a column, has text, gaps
    or unordered times, or is shorter than the run.
    """
    file = series.file
    names = (series.time, series.acceleration or series.displacement)
    times, values = _read_npz(file, names) if file.suffix.lower() == ".npz" else read_columns(file, names).values()
    _check(file, names, times, values)
    times = times - times[0]
    if times[-1] < duration * (1.0 - 1e-9):
        raise SceneError(f"{file}: lasts {times[-1]:g} s, the scene {duration:g} s; shorten the duration")
    if series.high_pass is not None:
        times, values = _integrated(times, values, series.high_pass)
    if np.abs(values).max() > _FARTHEST:
        raise SceneError(f"{file}: given up to {np.abs(values).max():g} m; allowed: {_FARTHEST:g} m; convert to metres")
    return times, values - (values[0] if series.offset is None else series.offset)


def _integrated(times: Array, acceleration: Array, high_pass: float) -> tuple[Array, Array]:
    """Return even times (n,) [s] and the displacement (n,) [m] of an acceleration (n,) [m/s^2], without slow drift.

    Through uneven times runs a cubic spline first. Less its mean, divided by -(2 pi f)^2 and by 1 + (high_pass / f)^8,
    which is a Butterworth filter of order 4 forwards and backwards, so without a shift of phase; and grown from rest
    within two periods of high_pass [Hz], where the filter does not know what was before. Raises SceneError.
    """
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
    from scipy.interpolate import CubicSpline

    length = float(times[-1])
    if high_pass * length < 4.0:
        allowed = f"at least {4.0 / length:.3g} Hz, of which the file has four periods"
        raise SceneError(f"excitation.series.high_pass: given {high_pass:g}; allowed: {allowed}; a longer file")
    even = np.linspace(0.0, length, len(times))
    step = even[1]
    uneven = np.abs(times - even).max() > 1e-3 * step
    values = CubicSpline(times, acceleration)(even) if uneven else acceleration
    count = next_fast_len(len(even) + math.ceil(8.0 / (high_pass * step)), real=True)  # zeros between end and begin
    f = rfftfreq(count, step)
    f[0] = 1.0
    spectrum = -rfft(values - np.mean(values), count) / ((2.0 * np.pi * f) ** 2 * (1.0 + (high_pass / f) ** 8))
    spectrum[0] = 0.0
    return even, irfft(spectrum, count)[: len(even)] * smooth_rise(even, 2.0 / high_pass)


def smooth_rise(times: Array, rise: float) -> Array:
    """Return a factor (n,) that grows from 0 to 1 in `rise` [s] at times (n,) [s], its first two derivatives smooth."""
    s = np.clip(times / rise, 0.0, 1.0)
    factor: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    return factor


def _check(file: Path, names: Sequence[str], times: Array, values: Array) -> None:
    if len(times) != len(values):
        given = f"{len(times)} times and {len(values)} displacements"
        raise SceneError(f"{file}: given {given}; allowed: as many of one as of the other")
    if len(times) < _FEWEST:
        raise SceneError(f"{file}: given {len(times)} samples; allowed: at least {_FEWEST}")
    for name, column in zip(names, (times, values), strict=True):
        missing = np.flatnonzero(~np.isfinite(column))
        if len(missing):
            where = f"sample {missing[0] + 1} of {shown(name)} is {column[missing[0]]}"
            raise SceneError(f"{file}: {where}; allowed: finite numbers; cut or repair the gaps first")
    late = np.flatnonzero(np.diff(times) < _CLOSEST)
    if len(late):
        at = late[0]
        order = f"time {times[at + 1]:g} s follows {times[at]:g} s (sample {at + 2})"
        raise SceneError(
            f"{file}: {order}; allowed: times that rise by {_CLOSEST:g} s or more; sort them, leave out doubles"
        )


def _read_npz(file: Path, names: Sequence[str]) -> list[Array]:
    try:
        arrays = read_arrays(file, _LARGEST_NPZ)
    except FileError as error:
        raise SceneError(f"{error}; {_NPZ}") from None
    for name in names:
        _known(file, name, list(arrays), "array")
    return [_real(file, name, arrays[name]) for name in names]


def _real(file: Path, name: str, array: NDArray[np.generic]) -> Array:
    if array.dtype.kind not in "fiu":
        given = f"array {shown(name)} is of type {array.dtype}"
        raise SceneError(f"{file}: {given}; allowed: real numbers in float or integer")
    if array.ndim != 1:
        raise SceneError(f"{file}: array {shown(name)} has shape {array.shape}; allowed: one dimension, (samples,)")
    return array.astype(np.float64)


def read_columns(file: Path, names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """Return the columns `names` of a CSV file, and those of `optional` that are there. Raises SceneError."""
    try:
        check(file, _LARGEST_CSV)
        with file.open(encoding="utf-8-sig", newline="") as stream:
            return _columns(file, _rows(file, stream), names, optional)
    except FileError as error:
        raise SceneError(f"{error}; give a CSV file") from None
    except OSError as error:
        raise SceneError(f"{file}: cannot be read: {error.strerror}; give a CSV file that can") from None
    except UnicodeDecodeError:
        raise SceneError(f"{file}: is not text in UTF-8; save it as CSV in UTF-8") from None


def _columns(
    file: Path, rows: Iterator[tuple[int, list[str]]], names: Sequence[str], optional: Sequence[str]
) -> dict[str, Array]:
    """Return the named columns below the header."""
    _, header = next(rows, (0, []))
    header[:1] = [name.lstrip("#").strip() for name in header[:1]]  # numpy.savetxt begins its header so
    names = [*names, *(name for name in optional if name in header)]
    for name in names:
        _known(file, name, header, "column")
    places = [header.index(name) for name in names]
    columns = [array("d") for _ in names]
    for line, row in rows:
        if len(row) != len(header):
            raise SceneError(f"{file}:{line}: {len(row)} columns; allowed: {len(header)}, as the header names")
        for name, place, column in zip(names, places, columns, strict=True):
            try:
                column.append(float(row[place]))
            except ValueError:
                given = f"{shown(name)} is {shown(row[place])}"
                raise SceneError(f"{file}:{line}: {given}; allowed: a number with a decimal point") from None
    return {name: np.array(column, dtype=np.float64) for name, column in zip(names, columns, strict=True)}


def _rows(file: Path, stream: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Yield (line, fields) of the header and of each line that is neither empty nor, below the header, a comment."""
    lines = csv.reader(stream, skipinitialspace=True, strict=True)
    first = True
    try:
        for row in lines:
            if not any(field.strip() for field in row) or (not first and row[0].startswith("#")):
                continue
            yield lines.line_num, [field.strip() for field in row]
            first = False
    except csv.Error as error:
        raise SceneError(f"{file}:{lines.line_num}: not readable as CSV ({error}); save it as CSV anew") from None


def _known(file: Path, name: str, have: Sequence[str], what: str) -> None:
    """Raise SceneError unless `name` is there exactly once."""
    if have.count(name) == 1:
        return
    if name in have:
        raise SceneError(f"{file}: two {what}s {shown(name)}; allowed: one of each name")
    listed = ", ".join(have[:8]) + (", ..." if len(have) > 8 else "") or "none"
    advice = "name yours in excitation.series (time, displacement)"
    raise SceneError(f"{file}: no {what} {shown(name)}; it has {listed[:200]}; {advice}")
