# SPDX-License-Identifier: Apache-2.0
"""A bag as labelled arrays: an xarray DataTree with a Dataset for each stream of samples and each topic, or pandas."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from atpid_control.export.source import Source
from atpid_control.export.tables import INDEX, RECEIVED, STAMP, TIME, Column, Table

#: Columns that are coordinates, not measured.
_COORDINATES = (TIME, STAMP, RECEIVED, INDEX)


def open_bag(path: Path | str, topics: Sequence[str] = ()) -> xr.DataTree:
    """Return a bag as a tree of Datasets by topic: `tree["sensors/laser"]["support_displacement"]`.

    Each has the dimension `time` [s], hardware time since the bag's first sample, with the exact `stamp` [ns] and, of
    samples, the `index` beside it; names, units and comments are attributes. Samples of different rates are Datasets
    of their own. A lost sample has its row with NaN, and `lost`, `gap_first_index`, `gap_samples` count them; what
    else is missing is in `tree.attrs["missing"]`. A bag that breaks off gives what is there. `topics`: those wanted;
    all where none is named. Raises BagError, ExportError.
    """
    source = Source(path, topics)
    kept = _arrays(source)
    places = _places([table.name for table in source.tables])
    found = {
        places[table.name]: _dataset(table, [kept[table.name][column.name] for column in table.columns])
        for table in source.tables
        if table.name in kept
    }
    if not found:
        raise source.empty()
    tree: xr.DataTree = xr.DataTree.from_dict(found)
    files = {name: data.decode(errors="replace") for name, data in source.files.items() if name.endswith(".yaml")}
    tree.attrs.update({**source.run, **source.result, "bag": str(path), "start_ns": source.start_ns,
                       "missing": source.missing, "files": files})  # fmt: skip
    return tree


def frames(path: Path | str, topics: Sequence[str] = ()) -> dict[str, pd.DataFrame]:
    """Return a bag as pandas tables by topic, `time` [s] as index; units and the rest are in `frame.attrs`.

    Otherwise as `open_bag`. Raises BagError, ExportError.
    """
    tree = open_bag(path, topics)
    made = {}
    for node in tree.leaves:
        frame = node.to_dataset().to_dataframe()
        units = {str(name): str(array.attrs.get("units", "")) for name, array in node.variables.items()}
        frame.attrs = {**node.attrs, "units": units, "missing": tree.attrs["missing"]}
        made[node.path.strip("/")] = frame
    return made


def _places(names: Sequence[str]) -> dict[str, str]:
    """Return each table's place in the tree, by its name.

    A topic that others stand under is `messages` beside them: a Dataset would have to have the times of those below.
    """
    paths = {name: "/" + "/".join("_" if set(part) <= {"."} else part for part in name.split("/")) for name in names}
    places: dict[str, str] = {}
    for name, path in paths.items():
        place = f"{path}/messages" if any(other.startswith(f"{path}/") for other in paths.values()) else path
        while place in places.values():
            place += "_"
        places[name] = place
    return places


def _arrays(source: Source) -> dict[str, dict[str, Any]]:
    """Read the bag into arrays by table and column."""
    parts: dict[str, list[tuple[Any, ...]]] = {}
    columns: dict[str, Sequence[Column]] = {}
    for piece in source.pieces():
        parts.setdefault(piece.table.name, []).append(piece.arrays)
        columns[piece.table.name] = piece.table.columns
    whole = {}
    for name in list(parts):
        arrays = zip(*parts.pop(name), strict=True)  # so that the pieces of one table at a time are held twice
        whole[name] = {c.name: np.concatenate(a) for c, a in zip(columns[name], arrays, strict=True)}
    return whole


def _dataset(table: Table, arrays: list[Any]) -> xr.Dataset:
    variables = {
        column.name: (TIME, array, _attributes(column)) for column, array in zip(table.columns, arrays, strict=True)
    }
    coordinates = {name: variables.pop(name) for name in _COORDINATES if name in variables}
    return xr.Dataset(variables, coordinates, table.about())


def _attributes(column: Column) -> dict[str, Any]:
    skew = {"skew": column.skew} if column.skew else {}
    return {"units": column.unit or "1", "long_name": column.description or column.name, **skew}
