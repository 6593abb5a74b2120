# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of text: any separator, decimal comma, lines above, units in names or in a row of their own, an index."""

import csv
import re
from collections import Counter
from itertools import islice
from pathlib import Path
from tempfile import gettempdir
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from atpid_common.files import Document, FileError, check
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Series
from atpid_control.runs.tables import INDEX, STAMP, TIME, Column, Table, common
from atpid_control.runs.tables import Columns as Arrays
from atpid_lab.imports.series import PIECE, Columns, mapped, si_of, timed

_SAMPLE = 1 << 17  # from which the layout is found [bytes]
_LINES, _STARTS, _SEPARATORS = 200, 20, ";\t,| "
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d")
_NAMED = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*")
#: pandas reads floats to the last digit by default from version 3 on.
_EXACT: Document = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
_RATE = re.compile(r"(?:rate|frequency|\bfs)\b\W*([0-9.,eE+]+)\s*(k?)Hz", re.IGNORECASE)


class _Layout(NamedTuple):
    separator: str
    decimal: str
    first: int  # line of the first row of numbers, from 0 on
    names: list[str]
    units: list[str]
    texts: list[int]  # columns that hold no numbers
    dates: list[int]


def read(path: Path, given: Given) -> list[Series]:
    """Return the columns of a table. Raises BagError."""
    columns, rate, start_ns = read_columns(path, given)
    return timed(path, "", columns, given, rate, start_ns)


def read_columns(path: Path, given: Given) -> tuple[Columns, float | None, int | None]:
    """Return unit and values (n,) of each column of numbers, and what is stated above: rate [Hz], first stamp [ns].

    An empty cell is NaN. Raises BagError.
    """
    lines, encoding = _lines(path)
    signs = [(separator, decimal) for separator in _SEPARATORS for decimal in ".," if separator != decimal]
    fits = filter(None, (_fit(lines, *one) for one in signs))
    _, layout = max(fits, key=lambda one: one[0], default=(None, None))
    if layout is None:
        raise BagError(f"{path}: no table of numbers in its first {_LINES} lines; save it as CSV with a line of names")
    stated = _RATE.search("\n".join(lines[: layout.first]))
    rate = float(stated[1].replace(",", ".")) * (1e3 if stated[2] else 1.0) if stated else None
    left = [layout.names[place] for place in layout.texts]
    given.notes += [f"{path.name}: {name}: left out, it holds no numbers" for name in left]
    columns, start_ns = _columns(path, layout, encoding, given)
    for name, (_, values) in list(columns.items()):
        if name.startswith("column_") and len(columns) > 1 and np.array_equal(values, np.arange(len(values))):
            given.notes.append(f"{path.name}: {name}: left out, it numbers the rows")
            del columns[name]
    return columns, rate, start_ns


def _lines(path: Path) -> tuple[list[str], str]:
    """Return the first lines, and the encoding."""
    with path.open("rb") as stream:
        raw = stream.read(_SAMPLE)
    encoding = "utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as error:
        cut = error.end >= len(raw) - 4 and len(raw) == _SAMPLE
        encoding = encoding if cut else "cp1252"
        text = raw.decode(encoding, "ignore")
    if "\0" in text:
        raise BagError(f"{path}: is no table of text; save it as CSV anew")
    return text.splitlines()[: -1 if len(raw) == _SAMPLE else None], encoding


def _fit(lines: list[str], separator: str, decimal: str) -> tuple[tuple[bool, int, int], _Layout] | None:
    """Return how well a separator and decimal sign fit, and the layout with them; None: not at all."""
    rows = [_cells(line, separator) for line in lines]
    starts = (place for place in range(min(len(rows) - 1, _LINES)) if not lines[place].lstrip().startswith("#"))
    starts = (at for at in starts if _is_data(rows[at], decimal) and not _numbers(*rows[at : at + 2]))
    # lines above a table may have numbers, too: `Samples 500 500`
    found = (_from(rows, first, separator, decimal) for first in islice(starts, _STARTS))
    return next(filter(None, found), None)


def _from(
    rows: list[list[str]], first: int, separator: str, decimal: str
) -> tuple[tuple[bool, int, int], _Layout] | None:
    """Return the same where the numbers begin in row `first`; None: they do not."""
    width, body = len(rows[first]), [row for row in rows[first : first + _LINES] if row != [""]]
    same = [row for row in body if len(row) == width]
    kinds = [[_kind(cell, decimal) for cell in column] for column in zip(*same, strict=True)]
    texts, dates = (
        [place for place, kind in enumerate(kinds) if kind.count(which) > 0.5 * len(kind)] for which in ("text", "date")
    )
    wrong = sum(kind.count("text") for place, kind in enumerate(kinds) if place not in texts)
    odd = any(kind[0] == "text" for place, kind in enumerate(kinds) if place not in texts)
    if odd or len(same) < max(2, 0.9 * len(body) - 1) or len(texts) == width or wrong > 0.1 * len(same) * width:
        return None
    headed, names, units = _names([row for row in rows[:first] if row != [""]], width)
    return (headed, width - len(texts), -wrong), _Layout(separator, decimal, first, names, units, texts, dates)


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.lstrip("#").split() or [""]  # numpy.savetxt begins its header so
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])] or [""]


def _kind(cell: str, decimal: str) -> str:
    if not cell or cell.lower() in ("nan", "na", "null", "inf", "-inf"):
        return "empty"
    if _DATE.match(cell):
        return "date"
    try:
        float(cell if decimal == "." else cell.replace(".", "x").replace(",", "."))
    except ValueError:
        return "text"
    return "number"


def _is_data(row: list[str], decimal: str) -> bool:
    kinds = [_kind(cell, decimal) for cell in row]
    return kinds.count("number") + kinds.count("date") >= max(1, kinds.count("text"))


def _numbers(row: list[str], after: list[str]) -> bool:
    """Whether a row holds 0, 1, 2, ..., which pandas writes for columns without names, and the next one does not."""
    row = row[1:] if row[0] == "" else row
    return len(row) > 0 and row == [str(place) for place in range(len(row))] and not all(map(str.isdigit, after))


def _names(above: list[list[str]], width: int) -> tuple[bool, list[str], list[str]]:
    """Return whether there are names above, the names, and their units."""
    rows = [[row[0].lstrip("# "), *row[1:]] for row in above[-3:]]
    rows = [["", *row] if len(row) == width - 1 > 0 else row for row in rows]
    fitting = [row for row in rows if len(row) == width and any(row)]
    names, units = (fitting[-1] if fitting else [""] * width), [""] * width
    if len(fitting) > 1 and width > 1 and not any(names[1:]):  # the name of pandas' index
        names, fitting = [names[0] or fitting[-2][0], *fitting[-2][1:]], fitting[:-1]
    if len(fitting) > 1 and any(names) and all(si_of(cell) is not None for cell in names):
        names, units = fitting[-2], names
    parted = [(found[1], found[2]) if (found := _NAMED.fullmatch(name)) else (name, "") for name in names]
    for place, (name, own) in enumerate(parted):
        before, slash, unit = name.rpartition("/")
        if slash and not own and si_of(unit):
            parted[place] = before, unit
    taken: list[str] = []
    for place, (name, _) in enumerate(parted):
        name = name.strip() or f"column_{place + 1}"
        taken.append(name if name not in taken else f"{name}_{place + 1}")
    return bool(fitting), taken, [unit or own for unit, (_, own) in zip(units, parted, strict=True)]


def _columns(path: Path, layout: _Layout, encoding: str, given: Given) -> tuple[Columns, int | None]:
    """Return unit and values (n,) of each column of numbers, mapped from a file, and the stamp of the first date."""
    places = [place for place in range(len(layout.names)) if place not in layout.texts]
    wrong, first = Counter[int](), dict[int, str]()
    start_ns: int | None = None

    def numbers(place: int, cells: "pd.Series[Any]") -> "pd.Series[Any]":
        nonlocal start_ns
        if place in layout.dates:
            stamps = pd.to_datetime(cells, format="ISO8601", utc=True).astype("datetime64[ns, UTC]").astype(np.int64)
            start_ns = int(stamps.iloc[0]) if start_ns is None else start_ns
            return (stamps - start_ns) * 1e-9
        if cells.dtype.kind in "fiub":
            return cells
        texts = cells.astype(str).str.strip().str.replace(layout.decimal, ".", regex=False)
        found = pd.to_numeric(texts, errors="coerce")
        bad = cells[found.isna() & cells.notna()]
        if len(bad):
            first.setdefault(place, f"{bad.iloc[0]!r} in row {bad.index[0] + 1}")
            wrong[place] += len(bad)
        return found

    separator = r"\s+" if layout.separator == " " else layout.separator
    text = {"encoding": encoding, "encoding_errors": "replace", "skipinitialspace": True, "decimal": layout.decimal}
    rows = {"skiprows": layout.first, "chunksize": min(PIECE, 1 + 64 * PIECE // len(places)), "low_memory": False}
    named = {"header": None, "names": range(len(layout.names)), "usecols": places, "index_col": False}
    with pd.read_csv(path, sep=separator, **text, **rows, **named, **_EXACT) as chunks:
        pieces = (np.column_stack([numbers(place, chunk[place]) for place in places]) for chunk in chunks)
        table = mapped(path, given, pieces).reshape(-1, len(places))
    for place, count in wrong.items():
        where = f"{path.name}: {layout.names[place]}"
        given.notes.append(f"{where}: {count} cells are no numbers, NaN: the first {first[place]}")
    return {layout.names[place]: (layout.units[place], table[:, n]) for n, place in enumerate(places)}, start_ns


#: Sampling instants of a table may be off the even grid by this share of a step.
_UNEVEN = 0.05
#: Size of a table at most [bytes].
_LARGEST = 100_000_000
#: Largest time: that of a stamp in nanoseconds, which is a whole number of 64 bits [s].
_LATEST = 9e9


def read_table(path: Path) -> tuple[Table, Arrays, list[str]]:
    """Return a table with its columns (n,), an empty cell NaN, and a line for what is left out or no number.

    Layouts are those of `bag import`. Raises BagError where it is no such table.
    """
    given = Given(Path(gettempdir()))
    try:
        check(path, _LARGEST)
        columns, _, _ = read_columns(path, given)
    except FileError as error:
        raise BagError(f"{error}; give a bag or a .csv table") from None
    except BagError:
        raise
    except (OSError, ValueError) as error:  # ValueError: of pandas, for rows that are no table
        raise BagError(f"{path}: cannot be read as a table: {error}; save it as CSV anew") from None
    if TIME not in columns:
        raise BagError(f"{path}: columns {', '.join(columns)[:200]}; needed: {TIME}")
    time = np.asarray(columns.pop(TIME)[1])
    if time.size < 2 or not np.all(np.abs(time) <= _LATEST):
        raise BagError(f"{path}: needs at least two finite times, of at most {_LATEST:g} s")
    step = (time[-1] - time[0]) / (time.size - 1)
    if not (step > 0.0 and np.abs(time - time[0] - step * np.arange(time.size)).max() < _UNEVEN * step):
        raise BagError(f"{path}: not evenly sampled; fill what is missing with empty cells")
    channels = {name: values for name, (_, values) in columns.items() if name not in (STAMP, INDEX)}
    known = (*common(TIME, STAMP, INDEX), *(Column(name, columns[name][0], "") for name in channels))
    table = Table("table", "table", "csv", known, float(1.0 / step), float(time[0]), rows=time.size)
    index = np.arange(time.size)
    return table, {TIME: time, STAMP: np.rint(1e9 * time).astype(np.int64), INDEX: index, **channels}, given.notes
