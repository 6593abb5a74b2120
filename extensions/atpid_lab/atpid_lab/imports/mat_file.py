# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""MATLAB: version 5 by scipy, in memory; version 7.3, which is HDF5, by h5py piece by piece.

Variables, and the fields of each struct, are a table: with times, or a rate, among them or beside the struct.
"""

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.io import loadmat, whosmat

from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Series
from atpid_control.runs.read import within_memory
from atpid_control.runs.tables import Values
from atpid_lab.imports.series import PIECE, RATES, STEPS, Columns, bounded, mapped, timed

#: A variable of either version: an array, a set of HDF5, a text, or a struct of them.
_Item: TypeAlias = Any
_Tree: TypeAlias = Mapping[str, _Item]
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Structs of this project's export that describe others.
_UNITS, _ABOUT = ("units", "unit"), ("names", "about")


def read(path: Path, given: Given) -> list[Series]:
    """Return the vectors and columns of matrices. Raises BagError."""
    with path.open("rb") as stream:
        start = stream.read(520)
    if _HDF5 in (start[:8], start[512:520]):
        import h5py

        with h5py.File(path, "r") as file:
            sets: list[_Item] = []
            file.visititems(lambda _, item: sets.append(item) if hasattr(item, "chunks") else None)
            # of a chunk, which is unpacked whole, more may be stated than of its set
            bounded(path, sum(max(one.size or 0, np.prod(one.chunks or (), dtype=float)) for one in sets))
            tree = {name: item for name, item in file.items() if not name.startswith("#")}
            found = _tables(path, "", tree, given, None)
    else:
        within_memory(path, 3 * path.stat().st_size)
        found = _tables(path, "", _loaded(path), given, None)
    if not found:
        raise BagError(f"{path}: no numbers with times or a rate in it; give --rate HZ, or another file")
    return found


def _loaded(path: Path) -> _Tree:
    """Return the variables of a file of version 5, read by a process of its own, which scipy ends for some damage."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            stated = pool.submit(whosmat, path).result()
            bounded(path, sum(np.prod(shape, dtype=float) for _, shape, kind in stated if kind != "sparse"))
            whole = pool.submit(loadmat, path, simplify_cells=True).result()
        except BrokenProcessPool:
            raise BagError(f"{path}: cannot be read as MATLAB 5, it is damaged; save it anew") from None
    return {name: item for name, item in whole.items() if not name.startswith("__")}


def _tables(path: Path, group: str, tree: _Tree, given: Given, rate: float | None) -> list[Series]:
    inner = {name: item for name, item in tree.items() if isinstance(item, Mapping) and name not in _ABOUT}
    units: _Tree = next((inner.pop(name) for name in _UNITS if name in inner), {})
    columns: Columns = {}
    scalars: dict[str, float] = {}
    for name, item in tree.items():
        if isinstance(item, Mapping):
            continue
        if reason := _unusable(item):
            given.notes.append(f"{path.name}: {group}{name}: left out, {reason}")
        elif np.size(item) == 1:
            scalars[name.lower()] = float(np.asarray(item).item())
        else:
            columns |= {key: (_text(units.get(key, "")), values) for key, values in _columns(path, name, item, given)}
    rate = next((scalars[name] for name in RATES if scalars.get(name, 0.0) > 0.0), rate)
    rate = next((1.0 / scalars[name] for name in STEPS if scalars.get(name, 0.0) > 0.0), rate)
    found: list[Series] = []
    stated = rate or given.rate
    if group and not stated and "stamp" in columns and "index" not in columns:
        given.notes.append(f"{path.name}: {group[:-1]}: left out, a table of messages, not evenly sampled")
    elif columns and (stated or any(name.lower() == "time" for name in columns) or not inner):
        found += timed(path, group, columns, given, rate)
    elif columns:
        given.notes.append(f"{path.name}: {group}{', '.join(columns)}: left out, no times and no rate beside them")
    for name, item in inner.items():
        found += _tables(path, f"{group}{name}/", item, given, rate)
    return found


def _unusable(item: _Item) -> str:
    """Return what an item is that has no numbers of at most two dimensions, else nothing."""
    if isinstance(item, str | bytes) or getattr(item, "attrs", {}).get("MATLAB_class", b"") == b"char":
        return "a text"
    kind, shape = (item if hasattr(item, "dtype") else np.asarray(item)).dtype.kind, np.shape(item)
    if kind not in "fiu":
        return "logical" if kind == "b" else "no real numbers"
    if 0 in shape:
        return "empty"
    return "" if len(shape) <= 2 or np.size(item) == 1 else "no table of two dimensions"


def _columns(path: Path, name: str, item: _Item, given: Given) -> Iterator[tuple[str, Values]]:
    """Yield the columns of a vector or matrix: samples go along the longer side. Those of HDF5 are kept in files."""
    shape = np.shape(item)
    across = len(shape) > 1 and shape[0] < shape[1]  # of HDF5, which has the transpose of MATLAB's, as a rule
    if not isinstance(item, np.ndarray):
        parts = (slice(begin, begin + PIECE) for begin in range(0, max(shape), PIECE))
        table = mapped(path, given, (item[:, part].T if across else item[part] for part in parts))
    else:
        table = item.T if across else item
    columns = table.reshape(max(shape), -1).T
    for place, values in enumerate(columns, 1):
        yield (name if len(columns) == 1 else f"{name}_{place}"), values


def _text(item: _Item) -> str:
    if isinstance(item, str):
        return item
    if getattr(item, "attrs", {}).get("MATLAB_class", b"") == b"char":
        return "".join(map(chr, np.ravel(item[:])))
    return ""
