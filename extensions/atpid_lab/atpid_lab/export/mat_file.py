# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""MATLAB's format 5: a struct a table with a column a field, and beside it their units and names in the bag."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.io.matlab import MatWriteError

from atpid_control.runs.errors import BagError
from atpid_control.runs.source import Source
from atpid_control.runs.tables import TEXT, Piece, Table
from atpid_lab.export.spool import Spool

#: Longest name in MATLAB.
_LONGEST = 63


def write(source: Source, pieces: Iterable[Piece], folder: Path) -> Iterator[tuple[Table | None, Path]]:
    """Write all tables to one file in `folder`; yield it. A column at a time is in memory.

    Raises OSError, BagError.
    """
    spool, path, names = Spool(folder), folder / "whole.mat", set[str]()
    spool.fill(pieces)
    structs = {_name(table.name, names): _struct(spool, table) for table in spool.tables}
    own = {"bag": str(source.path), "start_ns": source.start_ns, "missing": _cells(source.missing)}
    taken: set[str] = set()
    about = {**source.run, **source.result, **own}
    structs[_name("about", names)] = {_name(key, taken): value for key, value in about.items()}
    try:
        savemat(path, structs, long_field_names=True, oned_as="column")
    except MatWriteError:
        raise BagError(
            f"{source.path}: --format mat: a table is larger than 4 GB, which the format cannot hold; give a part with "
            "--from and --to, or --format csv or parquet"
        ) from None
    yield None, path


def _struct(spool: Spool, table: Table) -> dict[str, object]:
    taken: set[str] = set()
    fields: dict[str, object] = {}
    units: dict[str, str] = {}
    names: dict[str, str] = {}
    for place, column in enumerate(table.columns):
        name = _name(column.name, taken)
        values = spool.column(table, place)
        fields[name] = _cells(values) if column.dtype == TEXT else values
        units[name], names[name] = column.unit, column.name
    about = {key: _cells(value) if key == "left_out_reasons" else value for key, value in table.about().items()}
    fields |= {_name("units", taken): units, _name("names", taken): names}
    return fields | {_name(f"about_{key}", taken): v for key, v in about.items()}


def _cells(texts: Iterable[str]) -> NDArray[np.object_]:
    """Return texts as a column of cells."""
    found = list(texts)
    cells = np.empty((len(found), 1), dtype=object)
    cells[:, 0] = found
    return cells


def _name(text: str, taken: set[str]) -> str:
    """Return a name MATLAB takes that is not among `taken`, and add it."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII).strip("_")[: _LONGEST - 3]
    name = name if name[:1].isalpha() else f"x{name}"
    number = 1
    while (free := name if number == 1 else f"{name}_{number}") in taken:
        number += 1
    taken.add(free)
    return free
