# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A table of numbers (.csv), evenly sampled, one column a channel and one `time` [s]: what stands in for a bag."""

from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from atpid_common.files import FileError, check
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given
from atpid_control.runs.tables import INDEX, STAMP, TIME, Column, Table, common
from atpid_lab.imports.csv_file import read_columns
from atpid_sim.system import Array

#: Sampling instants of a table may be off the even grid by this share of a step.
_UNEVEN = 0.05
#: Size of a table at most [bytes].
_LARGEST = 100_000_000
#: Largest time: that of a stamp in nanoseconds, which is a whole number of 64 bits [s].
_LATEST = 9e9


def read_table(path: Path) -> tuple[Table, dict[str, Any], list[str]]:
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
    rate = _even_rate(time, path)
    channels = {name: values for name, (_, values) in columns.items() if name not in (STAMP, INDEX)}
    known = (*common(TIME, STAMP, INDEX), *(Column(name, columns[name][0], "") for name in channels))
    table = Table("table", "table", "csv", known, rate, float(time[0]), rows=time.size)
    index = np.arange(time.size)
    return table, {TIME: time, STAMP: np.rint(1e9 * time).astype(np.int64), INDEX: index, **channels}, given.notes


def _even_rate(time: Array, path: Path) -> float:
    if time.size < 2 or not np.all(np.abs(time) <= _LATEST):
        raise BagError(f"{path}: needs at least two finite times, of at most {_LATEST:g} s")
    step = (time[-1] - time[0]) / (time.size - 1)
    if not (step > 0.0 and np.abs(time - time[0] - step * np.arange(time.size)).max() < _UNEVEN * step):
        raise BagError(f"{path}: not evenly sampled; fill what is missing with empty cells")
    return float(1.0 / step)
