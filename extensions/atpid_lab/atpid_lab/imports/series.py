# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What readers of files share: columns as series with the times they were sampled at, and values kept on disk."""

import math
import re
from collections.abc import Iterable
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from atpid_common.files import parse_yaml
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Grid, Series
from atpid_control.runs.read import MOST_HELD
from atpid_control.runs.tables import Values

_TABLE = parse_yaml(files(__package__).joinpath("data", "units.yaml").read_text(encoding="utf-8"))
_UNITS = {name: (unit, factor) for unit, names in _TABLE["plain"].items() for name, factor in names.items()}
_PREFIXED = {name: unit for unit, names in _TABLE["prefixed"].items() for name in names}
_OVER_TIME = re.compile(r"(.+?)(?:/s(?:ec)?(?:\^?([23]))?|s\^?-([123]))")


def si_of(given: str) -> tuple[str, float] | None:
    """Return the SI unit that a unit is converted to, and its factor; None: the unit is not known.

    `g` is the standard acceleration of free fall, `mg` a thousandth of it: sensors measure no grams.
    """
    text = given.strip().strip("[]()").strip().replace("²", "^2").replace("³", "^3").replace("**", "^")
    text = re.sub(r"[\sµμ·*]", lambda sign: "u" if sign[0] in "µμ" else "", text.replace("⁻", "-"))
    if text.lower() in _UNITS and text not in ("G", "MG", "Mg"):
        return _UNITS[text.lower()]
    for prefix, factor in _TABLE["prefixes"].items():
        rest = text.removeprefix(prefix)
        known = _PREFIXED.get(rest, _PREFIXED.get(rest.lower()) if len(rest) > 2 else None)
        if text.startswith(prefix) and known is not None:
            return known, factor
    if found := _OVER_TIME.fullmatch(text):
        power, length = found[2] or found[3] or "1", si_of(found[1])
        if length and length[0] == "m":
            return f"m/s{'' if power == '1' else f'^{power}'}", length[1]
    return None


#: Columns of a table by name, each its unit and its values (n,), which are taken by slices.
Columns = dict[str, tuple[str, Values]]
#: Values read at once of a channel.
PIECE = 65_536
#: Instants may be off the even grid by this share of a step, besides their last digit; a longer step is a gap.
_UNEVEN, _SHORT, _GAP = 0.05, 0.5, 1.5
_MOST_GAPS = 1000
_BY_ROWS = "give --rate HZ to go by rows"
_ADVICE = f"{_BY_ROWS}, or sample it anew at an even rate"
#: Names of a column of times, where it has no other.
_TIMES = ("time", "t", "zeit", "times", "timestamp", "x_value", "x", "seconds", "sec", "date", "datetime")
#: Columns of this project's exports that only repeat the time.
_OF_TIME = {"stamp": "ns", "index": ""}
_OF_RATES = "fs rate sample_rate samplerate sampling_rate samplingrate sampling_frequency samplefrequency about_rate"
RATES, STEPS = _OF_RATES.split(), ["dt", "delta_t", "increment"]


def bounded(path: Path, numbers: float) -> None:
    """Raise BagError where a file states, or unpacks to, more numbers than a file of its size has, or memory holds."""
    size = path.stat().st_size
    if numbers > max(size, min(MOST_HELD, 1000 * size) // 8):  # nothing is packed (deflate) to less than a thousandth
        raise BagError(f"{path}: {numbers:.3g} numbers in {size / 1e6:.3g} MB: more than it can hold; save it anew")


def mapped(path: Path, given: Given, pieces: Iterable[ArrayLike]) -> Values:
    """Return the values of pieces, one after the other (n,), mapped from a nameless file. Raises BagError, OSError."""
    with TemporaryFile(dir=given.folder) as stream:
        for piece in pieces:
            bounded(path, stream.tell() // 8 + np.size(piece))
            stream.write(np.ascontiguousarray(piece, np.float64).data)
        return np.memmap(stream, np.float64, "r") if stream.tell() else np.zeros(0)


def timed(
    path: Path, group: str, columns: Columns, given: Given, rate: float | None = None, start_ns: int | None = None
) -> list[Series]:
    """Return series of columns (n,), given as unit and values, with the times that one of them has [s], or a rate.

    `rate` [Hz] and `start_ns` are what the file states. Raises BagError: neither, or no even times.
    """
    usual = [known for known in _TIMES if known != "x" or not (rate or given.rate)]
    time = given.time or next((name for known in usual for name in columns if name.lower() == known), "")
    if given.time and time not in columns:
        raise BagError(f"{path}: --time: given {time}; in the file: {', '.join(columns)[:200]}")
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
        unit, times = columns[time]
        grid = even(f"{path}: {group}{time}", np.asarray(times, np.float64), unit, given, start_ns)
    else:
        names = ", ".join(columns)[:200]
        raise BagError(f"{path}: no times and no rate in it; give --rate HZ, or --time with one of {names}")
    return [Series(f"{group}{name}", unit, values, grid) for name, (unit, values) in others.items()]


def even(where: str, times: NDArray[np.float64], unit: str, given: Given, start_ns: int | None = None) -> Grid:
    """Return the grid of times (n,) in `unit`, whole samples that are missing as jumps. Raises BagError: uneven."""
    known = si_of(unit or "s")
    if known is None or known[0] != "s":
        raise BagError(f"{where}: its unit is {unit!r}; allowed: one of time; {_BY_ROWS}")
    if len(times) < 2 or not np.isfinite(times).all():
        raise BagError(f"{where}: needs two times at least, all finite; {_BY_ROWS}")
    apart = np.diff(times)
    step, digit = float(np.median(apart[:PIECE])), _last_digit(times[:PIECE])
    if not step > 0.0:
        raise BagError(f"{where}: does not rise; {_BY_ROWS}")
    if (early := np.flatnonzero(apart <= _SHORT * step)).size:
        raise BagError(f"{where}: not evenly sampled at row {early[0] + 2}; {_ADVICE}")
    gaps = np.flatnonzero(apart >= _GAP * step)
    if len(gaps) > min(_MOST_GAPS, len(apart) - len(gaps)):
        raise BagError(f"{where}: not evenly sampled, {len(gaps)} steps are longer than others; {_ADVICE}")
    lasted = float(times[-1] - times[0] - apart[gaps].sum())
    step = lasted / (len(apart) - len(gaps))
    off = max(_UNEVEN * step, 1.01 * digit)
    for begin, end in pairwise([0, *(gaps + 1), len(times)]):
        away = np.abs(times[begin:end] - times[begin] - np.arange(end - begin) * step)
        if away.max() > off:
            row = begin + int(np.argmax(away > off))
            raise BagError(f"{where}: not evenly sampled, off by {away.max() / step:.2g} steps at row {row}; {_ADVICE}")
    steps = np.rint(apart[gaps] / step)
    missing = np.cumsum(steps - 1.0).astype(np.int64)
    if len(gaps):
        odd = int((np.abs(apart[gaps] - steps * step) > off).sum())
        shifted = f"; {odd} of them no whole number of samples: what follows is off by half a sample" if odd else ""
        given.notes.append(f"{where}: {len(gaps)} gaps, {missing[-1]} samples missing{shifted}")
    at = round(float(times[0]) * known[1] * 1e9) if start_ns is None else start_ns
    jumps = tuple(zip((gaps + 1).tolist(), (gaps + 1 + missing).tolist(), strict=True))
    return Grid(shortest(1.0 / (step * known[1]), digit / lasted), len(times), at, start_ns is not None, jumps)


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
