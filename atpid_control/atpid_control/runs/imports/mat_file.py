# SPDX-License-Identifier: Apache-2.0
"""MATLAB: version 5 by scipy, in memory; version 7.3, which is HDF5, by h5py piece by piece.

Variables, and the fields of each struct, are a table: with times, or a rate, among them or beside the struct.
"""

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from atpid_control.runs.errors import BagError
from atpid_control.runs.imports.series import PIECE, RATES, STEPS, Given, Series, mapped, timed
from atpid_control.runs.read import within_memory

_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Structs of this project's export that describe others.
_UNITS, _ABOUT = ("units", "unit"), ("names", "about")


def read(path: Path, given: Given) -> list[Series]:
    """Return the vectors and columns of matrices. Raises BagError."""
    with path.open("rb") as stream:
        start = stream.read(520)
    if _HDF5 in (start[:8], start[512:520]):
        import h5py

        file = given.open.enter_context(h5py.File(path, "r"))
        tree: Mapping[str, Any] = {name: item for name, item in file.items() if not name.startswith("#")}
    else:
        within_memory(path, 3 * path.stat().st_size)
        tree = _loaded(path)
    found = _tables(path, "", tree, given, None)
    if not found:
        raise BagError(f"{path}: no numbers with times or a rate in it; give --rate HZ, or another file")
    return found


def _loaded(path: Path) -> dict[str, Any]:
    """Return the variables of a file of version 5, read by a process of its own, which scipy ends for some damage."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            whole = pool.submit(loadmat, path, simplify_cells=True).result()
        except BrokenProcessPool:
            raise BagError(f"{path}: cannot be read as MATLAB 5, it is damaged; save it anew") from None
    return {name: item for name, item in whole.items() if not name.startswith("__")}


def _tables(path: Path, group: str, tree: Mapping[str, Any], given: Given, rate: float | None) -> list[Series]:
    columns: dict[str, tuple[str, Any]] = {}
    scalars: dict[str, float] = {}
    inner: dict[str, Any] = {}
    for name, item in tree.items():
        if isinstance(item, Mapping):
            inner[name] = {key: value for key, value in item.items() if not key.startswith("#")}
            continue
        kind = _kind(item)
        if kind == "number":
            scalars[name.lower()] = float(np.asarray(item).item())
        elif kind:
            given.notes.append(f"{path.name}: {group}{name}: left out, {kind}")
        else:
            columns |= {key: ("", values) for key, values in _columns(name, item, given)}
    rate = next((scalars[name] for name in RATES if scalars.get(name, 0.0) > 0.0), rate)
    rate = next((1.0 / scalars[name] for name in STEPS if scalars.get(name, 0.0) > 0.0), rate)
    units: Mapping[str, Any] = next((inner.pop(name) for name in _UNITS if name in inner), {})
    columns = {name: (_text(units.get(name, "")), values) for name, (_, values) in columns.items()}
    found: list[Series] = []
    longest = max((len(values) for _, values in columns.values()), default=0)
    if longest > 1 and (rate or given.rate or any(name.lower() == "time" for name in columns) or not inner):
        if group and not (rate or given.rate) and "stamp" in columns and "index" not in columns:
            given.notes.append(f"{path.name}: {group[:-1]}: left out, a table of messages, not evenly sampled")
        else:
            found += timed(path, group, columns, given, rate)
    elif columns:
        given.notes.append(f"{path.name}: {group}{', '.join(columns)}: left out, no times and no rate beside them")
    for name, item in inner.items():
        if name not in _ABOUT:
            found += _tables(path, f"{group}{name}/", item, given, rate)
    return found


def _kind(item: Any) -> str:
    """Return `number` for a scalar, nothing for what has rows of numbers, else what it is."""
    if isinstance(item, str | bytes) or getattr(item, "attrs", {}).get("MATLAB_class", b"") == b"char":
        return "a text"
    kind, shape = np.dtype(getattr(item, "dtype", np.asarray(item).dtype)).kind, np.shape(item)
    if kind not in "fiu":
        return "logical" if kind == "b" else "no real numbers"
    if int(np.prod(shape)) == 1:
        return "number"
    return "" if len(shape) in (1, 2) and min(shape) > 0 else "no table of two dimensions" if shape else "empty"


def _columns(name: str, item: Any, given: Given) -> Iterator[tuple[str, Any]]:
    """Yield the columns of a vector or matrix: samples go along the longer side. Those of HDF5 are kept in files."""
    shape = np.shape(item)
    rows = len(shape) > 1 and shape[0] < shape[1]  # of HDF5, which has the transpose of MATLAB's, as a rule
    for place in range(min(shape) if len(shape) > 1 else 1):
        values = item if len(shape) == 1 else None
        if isinstance(item, np.ndarray) and values is None:
            values = item[place] if rows else item[:, place]
        elif not isinstance(item, np.ndarray):
            parts = (slice(begin, begin + PIECE) for begin in range(0, max(shape), PIECE))
            cut = (part if len(shape) == 1 else (place, part) if rows else (part, place) for part in parts)
            values = mapped(given, (item[one] for one in cut))
        yield (name if len(shape) == 1 or min(shape) == 1 else f"{name}_{place + 1}"), values


def _text(item: Any) -> str:
    if isinstance(item, str):
        return item
    if getattr(item, "attrs", {}).get("MATLAB_class", b"") == b"char":
        return "".join(map(chr, np.ravel(item[:])))
    return ""
