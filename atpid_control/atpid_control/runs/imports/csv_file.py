# SPDX-License-Identifier: Apache-2.0
"""Tables of text: any separator, decimal comma, lines above, units in names or in a row of their own, an index."""

import csv
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from atpid_control.runs.errors import BagError
from atpid_control.runs.imports.series import PIECE, Given, Series, timed
from atpid_control.runs.imports.units import si_of

_SAMPLE = 1 << 17  # from which the layout is found [bytes]
_LINES, _SEPARATORS = 200, ";\t,| "
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d")
_NAMED = re.compile(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*")
#: pandas reads floats to the last digit by default from version 3 on.
_EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
_RATE = re.compile(r"(?:rate|frequency|\bfs)\b\W*([0-9.,eE+]+)\s*(k?)Hz", re.IGNORECASE)


class _Layout(NamedTuple):
    separator: str
    decimal: str
    encoding: str
    first: int  # line of the first row of numbers, from 0 on
    names: list[str]
    units: list[str]
    texts: list[int]  # columns that hold no numbers
    dates: list[int]
    rate: float | None  # stated above the table [Hz]


def read(path: Path, given: Given) -> list[Series]:
    """Return the columns of a table. Raises BagError."""
    layout = _layout(path)
    left = [name for place, name in enumerate(layout.names) if place in layout.texts]
    given.notes += [f"{path.name}: {name}: left out, it holds no numbers" for name in left]
    columns, start_ns = _columns(path, layout, given)
    for name, (_, values) in list(columns.items()):
        counts = name.startswith("column_") and len(columns) > 1 and np.array_equal(values, np.arange(len(values)))
        if counts:
            given.notes.append(f"{path.name}: {name}: left out, it numbers the rows")
            del columns[name]
    return timed(path, "", columns, given, layout.rate, start_ns)


def _layout(path: Path) -> _Layout:
    with path.open("rb") as stream:
        raw = stream.read(_SAMPLE)
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    encoding = "utf-16" if wide else "utf-8-sig"
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as error:
        cut = error.end >= len(raw) - 4 and len(raw) == _SAMPLE
        encoding = encoding if cut else "cp1252"
        text = raw.decode(encoding, "ignore")
    if "\0" in text:
        raise BagError(f"{path}: is no table of text; save it as CSV anew")
    lines = text.splitlines()[: -1 if len(raw) == _SAMPLE else None]
    found = (_fit(lines, separator, decimal) for separator in _SEPARATORS for decimal in ".,"
             if separator != decimal)  # fmt: skip
    best = max(filter(None, found), key=lambda one: one[0], default=None)
    if best is None:
        raise BagError(f"{path}: no table of numbers in its first {_LINES} lines; save it as CSV with a line of names")
    _, separator, decimal, first, names, units, (texts, dates) = best
    stated = _RATE.search("\n".join(lines[:first]))
    rate = float(stated[1].replace(",", ".")) * (1e3 if stated[2] else 1.0) if stated else None
    return _Layout(separator, decimal, encoding, first, names, units, texts, dates, rate)


def _fit(lines: list[str], separator: str, decimal: str) -> Any:
    """Return how well a separator and decimal sign fit, and the layout with them; None: not at all."""
    rows = [_cells(line, separator) for line in lines]
    for first in range(min(len(rows) - 1, _LINES)):
        width, body = len(rows[first]), [row for row in rows[first : first + _LINES] if row != [""]]
        if (
            lines[first].lstrip().startswith("#")
            or not _is_data(rows[first], decimal)
            or _numbers(rows[first : first + 2])
        ):
            continue
        same = [row for row in body if len(row) == width]
        if len(same) < max(2, 0.9 * len(body) - 1):
            return None
        kinds = [[_kind(row[place], decimal) for row in same] for place in range(width)]
        texts = [place for place, kind in enumerate(kinds) if kind.count("text") > 0.5 * len(kind)]
        dates = [place for place, kind in enumerate(kinds) if kind.count("date") > 0.5 * len(kind)]
        wrong = sum(kind.count("text") for place, kind in enumerate(kinds) if place not in texts)
        if len(texts) == width or wrong > 0.1 * len(same) * width:
            return None
        headed, names, units = _names([row for row in rows[:first] if row != [""]], width)
        return (headed, width - len(texts), -wrong), separator, decimal, first, names, units, (texts, dates)
    return None


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split() or [""]
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


def _numbers(two: list[list[str]]) -> bool:
    """Whether the first of two rows holds 0, 1, 2, ..., which pandas writes for columns without names."""
    row = two[0][1:] if two[0][0] == "" else two[0]
    return len(row) > 0 and row == [str(place) for place in range(len(row))] and two[0] != two[-1] and any(
        not cell.isdigit() for cell in two[-1])  # fmt: skip


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
    parted = [(name.rpartition("/")[0], unit) if not own and "/" in name and si_of(unit := name.rpartition("/")[2])
              else (name, own) for name, own in parted]  # fmt: skip
    taken: list[str] = []
    for place, (name, _) in enumerate(parted):
        name = name.strip() or f"column_{place + 1}"
        taken.append(name if name not in taken else f"{name}_{place + 1}")
    return bool(fitting), taken, [unit or own for unit, (_, own) in zip(units, parted, strict=True)]


def _columns(path: Path, layout: _Layout, given: Given) -> tuple[dict[str, tuple[str, Any]], int | None]:
    """Return unit and values (n,) of each column of numbers, mapped from files, and the stamp of the first date."""
    places = [place for place in range(len(layout.names)) if place not in layout.texts]
    files = {place: given.folder / f"{len(list(given.folder.iterdir()))}.{place}" for place in places}
    wrong: dict[int, tuple[int, str]] = {}
    rows, start_ns = 0, None
    with ExitStack() as stack:
        streams = {place: stack.enter_context(file.open("wb")) for place, file in files.items()}
        for chunk in _chunks(path, layout, places):
            for place, cells in zip(places, chunk, strict=True):
                if place in layout.dates:
                    stamps = pd.to_datetime(chunk[cells], format="ISO8601", utc=True).astype("datetime64[ns, UTC]")
                    stamps_ns = stamps.astype(np.int64)
                    start_ns = int(stamps_ns.iloc[0]) if start_ns is None else start_ns
                    values = (stamps_ns - start_ns).to_numpy() * 1e-9
                else:
                    values, bad = _numeric(chunk[cells], layout.decimal)
                    if bad.size:
                        count, first = wrong.get(
                            place, (0, f"{chunk[cells].iloc[bad[0]]!r} in row {rows + bad[0] + 1}")
                        )
                        wrong[place] = count + len(bad), first
                streams[place].write(np.ascontiguousarray(values, np.float64).data)
            rows += len(chunk)
    for place, (count, first) in wrong.items():
        given.notes.append(f"{path.name}: {layout.names[place]}: {count} cells are no numbers, NaN: the first {first}")
    names = {layout.names[place]: place for place in places}
    return {
        name: (layout.units[place], np.memmap(files[place], np.float64, "r")) for name, place in names.items()
    }, start_ns


def _chunks(path: Path, layout: _Layout, places: list[int]) -> Iterator[pd.DataFrame]:
    separator = r"\s+" if layout.separator == " " else layout.separator
    reading = pd.read_csv(
        path, sep=separator, decimal=layout.decimal, header=None, skiprows=layout.first, usecols=places,
        names=range(len(layout.names)), index_col=False, chunksize=PIECE, encoding=layout.encoding,
        **_EXACT, low_memory=False, skipinitialspace=True, encoding_errors="replace",
    )  # fmt: skip
    with reading:
        yield from reading


def _numeric(cells: "pd.Series[Any]", decimal: str) -> tuple[Any, Any]:
    """Return numbers (n,), NaN where a cell is none, and the rows of such cells that are not empty."""
    if cells.dtype.kind in "fiub":
        return cells.to_numpy(np.float64), np.zeros(0, np.int64)
    texts = cells.astype(str).str.strip()
    plain = texts if decimal == "." else texts.str.replace(",", ".")
    numbers = pd.to_numeric(plain, errors="coerce").to_numpy(np.float64)
    return numbers, np.flatnonzero(
        np.isnan(numbers) & cells.notna().to_numpy() & (texts.str.lower() != "nan").to_numpy()
    )
