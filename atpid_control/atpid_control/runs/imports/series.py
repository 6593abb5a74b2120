# SPDX-License-Identifier: Apache-2.0
"""What a reader of files gives: channels with their names and units as the file has them, and when they were sampled.

A format is a module with one `Reader`, in the table of `make`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from atpid_control.runs.errors import BagError
from atpid_control.runs.imports.units import si_of

#: Values read at once of a channel.
PIECE = 65_536
#: Instants may be off the even grid by this share of a step, besides their last digit; a longer step is a gap.
_UNEVEN, _GAP = 0.05, 1.5
_MOST_GAPS = 1000
#: Names of a column of times, where it has no other.
_TIMES = ("time", "t", "zeit", "times", "timestamp", "x_value", "x", "seconds", "sec", "date", "datetime")
#: Columns of this project's exports that only repeat the time.
_OF_TIME = {"stamp": "ns", "index": ""}
RATES, STEPS = ("fs", "rate", "sample_rate", "samplerate", "sampling_rate", "samplingrate", "sampling_frequency",
                "samplefrequency", "about_rate"), ("dt", "delta_t", "increment")  # fmt: skip


@dataclass(frozen=True)
class Grid:
    """When samples were taken: series of the same grid were sampled together."""

    rate: float  # [Hz]
    rows: int
    start_ns: int = 0  # stamp of the first sample since 1970, else after the file's own zero [ns]
    dated: bool = False  # whether it is since 1970
    jumps: tuple[tuple[int, int], ...] = ()  # (row, index of its sample) after each gap


@dataclass(frozen=True)
class Series:
    """One channel."""

    name: str  # in the file; a group or a struct it is in stands before it, with /
    unit: str  # as the file spells it; empty: not stated
    values: Any  # (n,) of numbers, taken by slices
    grid: Grid


@dataclass
class Given:
    """What a reader is given, and what it reports besides series."""

    folder: Path  # for files that last until the bag is written
    open: ExitStack  # for what must stay open until then
    rate: float | None = None  # [Hz]: rows count as even
    time: str = ""  # name of the column with times
    notes: list[str] = field(default_factory=list)  # what was converted, assumed or left out, a line each


class Reader(Protocol):
    """Reads one file. Raises BagError where it is none of its kind; other errors of a library count as that too.

    A library that set-up leaves out is imported in it.
    """

    def __call__(self, path: Path, given: Given) -> list[Series]:
        """Return the channels of a file."""


def mapped(given: Given, pieces: Iterable[Any]) -> Any:
    """Return the values of pieces (k,), one after the other (n,), mapped from a file. Raises OSError."""
    path = given.folder / str(sum(1 for _ in given.folder.iterdir()))
    with path.open("wb") as stream:
        for piece in pieces:
            stream.write(np.ascontiguousarray(piece, np.float64).data)
    return np.memmap(path, np.float64, "r") if path.stat().st_size else np.zeros(0)


def timed(
    path: Path, group: str, columns: Mapping[str, tuple[str, Any]], given: Given, rate: float | None = None,
    start_ns: int | None = None,
) -> list[Series]:  # fmt: skip
    """Return series of columns (n,), given as unit and values, with the times that one of them has [s], or a rate.

    `rate` [Hz] and `start_ns` are what the file states. Raises BagError: neither, or no even times.
    """
    time = _time_column(path, columns, given)
    lengths = [len(values) for _, values in columns.values()]
    rows = len(columns[time][1]) if time else max(lengths, key=lengths.count)
    others = {name: its for name, its in columns.items() if name != time}
    for name, unit in _OF_TIME.items():
        if name in others and si_of(others[name][0]) == si_of(unit) and time:
            if name == "stamp" and len(values := others[name][1]):
                start_ns = int(values[0])
            given.notes.append(f"{path.name}: {group}{name}: taken as time of the samples, no channel")
            del others[name]
    for name in [name for name, (_, values) in others.items() if len(values) != rows]:
        given.notes.append(f"{path.name}: {group}{name}: left out, {len(others.pop(name)[1])} values for {rows} times")
    if given.rate or (rate and not time):
        if time:
            given.notes.append(f"{path.name}: {group}{time}: left out, rows count as even at --rate {given.rate:g} Hz")
        grid = Grid(given.rate or rate or 1.0, rows, start_ns or 0, start_ns is not None)
    elif time:
        grid = even(f"{path}: {group}{time}", columns[time][1], columns[time][0], given, start_ns)
    else:
        raise BagError(
            f"{path}: no times and no rate in it; give --rate HZ, or --time with one of {', '.join(columns)[:200]}"
        )
    return [Series(f"{group}{name}", unit, values, grid) for name, (unit, values) in others.items()]


def _time_column(path: Path, columns: Mapping[str, Any], given: Given) -> str:
    if given.time:
        if given.time not in columns:
            raise BagError(f"{path}: --time: given {given.time}; in the file: {', '.join(columns)[:200]}")
        return given.time
    return next((name for known in _TIMES for name in columns if name.lower() == known), "")


def even(where: str, times: Any, unit: str, given: Given, start_ns: int | None = None) -> Grid:
    """Return the grid of times (n,) in `unit`, whole samples that are missing as jumps. Raises BagError: uneven."""
    known = si_of(unit or "s")
    if known is None or known[0] != "s":
        raise BagError(f"{where}: its unit is {unit!r}; allowed: one of time; give --rate HZ to go by rows")
    first = np.asarray(times[:PIECE], np.float64)
    if len(first) < 2 or not np.isfinite(first).all():
        raise BagError(f"{where}: needs two times at least, all finite; give --rate HZ to go by rows")
    step, digit = float(np.median(np.diff(first))), _last_digit(first)
    if not step > 0.0:
        raise BagError(f"{where}: does not rise; give --rate HZ to go by rows")
    steps, lasted, gaps = 0, 0.0, list[tuple[int, float]]()
    for begin, part in _pieces(times):
        apart = np.diff(part)
        if (bad := np.flatnonzero(~(apart > (2.0 - _GAP) * step))).size:
            raise BagError(f"{where}: not evenly sampled at row {begin + int(bad[0]) + 2}; {_ADVICE}")
        whole = apart < _GAP * step
        steps, lasted = steps + int(whole.sum()), lasted + float(apart[whole].sum())
        gaps += [(begin + int(row) + 1, float(apart[row])) for row in np.flatnonzero(~whole)]
        if len(gaps) > _MOST_GAPS or len(gaps) > steps:
            raise BagError(f"{where}: not evenly sampled, {len(gaps)} steps are longer than others; {_ADVICE}")
    exact = lasted / steps
    off = max(_UNEVEN * exact, 1.01 * digit)
    _check_even(where, times, exact, [row for row, _ in gaps], off)
    jumps, index, before, odd = [], 0, 0, 0
    for row, apart_s in gaps:
        missing = round(apart_s / exact)
        odd += abs(apart_s / exact - missing) * exact > off
        index, before = index + row - before - 1 + missing, row
        jumps.append((row, index))
    if jumps:
        shifted = f"; {odd} of them no whole number of samples: what follows is off by half a sample" if odd else ""
        given.notes.append(f"{where}: {len(jumps)} gaps, {jumps[-1][1] - jumps[-1][0]} samples missing{shifted}")
    scale, zero = known[1], float(first[0])
    at = round(zero * scale * 1e9) if start_ns is None else start_ns
    return Grid(shortest(1.0 / (exact * scale), digit / lasted), len(times), at, start_ns is not None, tuple(jumps))


_ADVICE = "give --rate HZ to go by rows, or sample it anew at an even rate"


def _pieces(times: Any) -> Any:
    """Yield (row, times from that row on), each piece with the first time of the next."""
    for begin in range(0, max(1, len(times) - 1), PIECE):
        yield begin, np.asarray(times[begin : begin + PIECE + 1], np.float64)


def _check_even(where: str, times: Any, step: float, starts: Sequence[int], off: float) -> None:
    """Raise BagError where times between gaps, which end at the rows `starts`, are off the even grid by `off`."""
    edges = np.array([0, *starts])
    zeros = np.array([float(times[int(row)]) for row in edges])
    for begin, part in _pieces(times):
        rows = np.arange(begin, begin + len(part))
        place = np.searchsorted(edges, rows, side="right") - 1
        away = np.abs(part - zeros[place] - (rows - edges[place]) * step)
        if not (away <= off).all():
            row = begin + int(np.argmax(~(away <= off)))
            raise BagError(f"{where}: not evenly sampled, off by {away.max() / step:.2g} steps at row {row}; {_ADVICE}")


def _last_digit(times: NDArray[np.float64]) -> float:
    """Return the value of the last decimal digit that times (n,) have, as far as a double has it."""
    least = 4.0 * float(np.spacing(np.abs(times).max()))
    for place in range(13):
        scaled = times * 10.0**place
        if (np.abs(scaled - np.rint(scaled)) <= 1e-6).all():
            return max(10.0**-place, least)
    return least


def shortest(rate: float, error: float) -> float:
    """Return the shortest number that a rate may be whose relative error is `error`."""
    near = (float(f"{rate:.{digits}g}") for digits in range(1, 17))
    return next((one for one in near if math.isclose(one, rate, rel_tol=error + 1e-15)), rate)
