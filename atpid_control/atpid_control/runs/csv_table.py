# SPDX-License-Identifier: Apache-2.0
"""A table of numbers (.csv), evenly sampled, one column a channel and one `time` [s]: what stands in for a bag."""

import csv
import math
from array import array
from collections.abc import Iterator
from itertools import chain, dropwhile
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.files import FileError, check
from atpid_control.runs.errors import BagError
from atpid_control.runs.tables import INDEX, STAMP, TIME, Column, Table, common
from atpid_sim.system import Array

#: Sampling instants of a table may be off the even grid by this share of a step.
_UNEVEN = 0.05
#: Size of a table at most [bytes].
_LARGEST = 100_000_000
#: Largest time: that of a stamp in nanoseconds, which is a whole number of 64 bits [s].
_LATEST = 9e9


def read_table(path: Path) -> tuple[Table, dict[str, Any], list[str]]:
    """Return a table with its columns (n,), an empty cell NaN, and a line for each column that is left out.

    A name may have its unit behind it, `time [s]`; comments (`#`) may stand above, as `export` writes them. Raises
    BagError where it is no such table.
    """
    try:
        check(path, _LARGEST)
        with path.open(newline="", encoding="utf-8-sig") as lines:
            before, head = next(dropwhile(lambda line: line[1].startswith("#"), enumerate(lines)), (0, ""))
            units, columns, missing = _columns(path, csv.reader(chain([head], lines)), before)
    except FileError as error:
        raise BagError(f"{error}; give a bag or a .csv table") from None
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise BagError(f"{path}: is no table in UTF-8; save it as CSV anew") from None
    time = columns.pop(TIME)
    rate = _even_rate(time, path)
    channels = {name: values for name, values in columns.items() if name not in (STAMP, INDEX)}
    known = (*common(TIME, STAMP, INDEX), *(Column(name, units[name], "") for name in channels))
    table = Table("table", "table", "csv", known, rate, float(time[0]), rows=time.size)
    index = np.arange(time.size)
    return table, {TIME: time, STAMP: np.rint(1e9 * time).astype(np.int64), INDEX: index, **channels}, missing


def _columns(
    path: Path, rows: Iterator[list[str]], before: int
) -> tuple[dict[str, str], dict[str, Array], list[str]]:  # fmt: skip
    """Return units and columns by name, and a line for each that holds no numbers; `before`: lines above the header."""
    head = [name.partition(" [") for name in next(rows, [])]
    header = [name.strip() for name, _, _ in head]
    if TIME not in header:
        raise BagError(f"{path}: columns {', '.join(header)[:200] or 'none'!r}; needed: {TIME}")
    columns, texts = [array("d") for _ in header], dict[int, str]()
    for number, row in enumerate(rows, 2 + before):
        if row and len(row) != len(header):
            raise BagError(f"{path}, row {number}: {len(row)} cells; allowed: {len(header)}, as the header has")
        for place, cell in enumerate(row):
            if place not in texts:
                try:
                    columns[place].append(float(cell) if cell.strip() else math.nan)
                except ValueError:
                    texts[place] = f"{path}, row {number}: {cell[:40]!r} is no number: not a table of numbers"
    if header.index(TIME) in texts:
        raise BagError(texts[header.index(TIME)])
    places: dict[str, int] = {}
    for place, name in enumerate(header):
        if place not in texts:
            places.setdefault(name, place)  # of two columns with one name the first counts
    units = {name: head[place][2].rstrip("] ") for name, place in places.items()}
    return units, {name: np.array(columns[place]) for name, place in places.items()}, [
        f"{line}; the column {header[place]} is left out" for place, line in texts.items()
    ]  # fmt: skip


def _even_rate(time: Array, path: Path) -> float:
    if time.size < 2 or not np.all(np.abs(time) <= _LATEST):
        raise BagError(f"{path}: needs at least two finite times, of at most {_LATEST:g} s")
    step = (time[-1] - time[0]) / (time.size - 1)
    if not (step > 0.0 and np.abs(time - time[0] - step * np.arange(time.size)).max() < _UNEVEN * step):
        raise BagError(f"{path}: not evenly sampled; fill what is missing with empty cells")
    return float(1.0 / step)
