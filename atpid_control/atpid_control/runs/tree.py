# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables as labelled arrays: an xarray DataTree with a Dataset for each stream of samples and each topic, or pandas."""

from collections.abc import Mapping, Sequence

import pandas as pd
import xarray as xr

from atpid_control.runs.tables import INDEX, RECEIVED, STAMP, TIME, Columns, Table

#: Columns that are coordinates, not measured.
_COORDINATES = (TIME, STAMP, RECEIVED, INDEX)


def tree_of(tables: Mapping[str, tuple[Table, Columns]]) -> xr.DataTree:
    """Return tables and their columns (n,) by name as a tree of Datasets.

    Each has the dimension `time` [s] with the exact `stamp` [ns] and, of samples, the `index` beside it; names, units
    and comments are attributes. Samples of different rates are Datasets of their own. A lost sample has its row with
    NaN, and `lost`, `gap_first_index`, `gap_samples` count them.
    """
    places = _places(list(tables))
    tree: xr.DataTree = xr.DataTree.from_dict({places[name]: _dataset(*tables[name]) for name in tables})
    return tree


def frames_of(tree: xr.DataTree) -> dict[str, pd.DataFrame]:
    """Return a tree as pandas tables by topic, `time` [s] as index; units and the rest are in `frame.attrs`."""
    frames = {}
    for node in tree.leaves:
        frame = node.to_dataset().to_dataframe()
        units = {str(name): str(array.attrs.get("units", "")) for name, array in node.variables.items()}
        frame.attrs = {**node.attrs, "units": units, "missing": tree.attrs["missing"]}
        frames[node.path.strip("/")] = frame
    return frames


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


def _dataset(table: Table, arrays: Columns) -> xr.Dataset:
    variables = {}
    for column in table.columns:
        about = {"units": column.unit or "1", "long_name": column.description or column.name}
        skew = {"skew": column.skew} if column.skew else {}
        variables[column.name] = TIME, arrays[column.name], {**about, **skew}
    coordinates = {name: variables.pop(name) for name in _COORDINATES if name in variables}
    return xr.Dataset(variables, coordinates, table.about())
