# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What results have in common: values shown with units, as text and HTML, as an xarray Dataset, and as curves."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import Field
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import extras
from atpid_sim.figure_style import LIGHT, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

#: Columns of an impact and their units: wall +1 floor, -1 ceiling; closing speed.
IMPACT = {"time": "s", "wall": "1", "speed": "m/s"}
#: An array of numbers, or of rows of named columns.
Rows = NDArray[Any]


def named_impacts(rows: NDArray[np.float64]) -> Rows:
    """Return impacts (k, 3), whose columns are `IMPACT`, as a structured array (k,): `impacts["speed"]`."""
    return np.array(list(map(tuple, rows)), dtype=[(name, float) for name in IMPACT])


def in_unit(unit: str, names: str, dims: str = "") -> dict[str, tuple[str, str]]:
    """Return the `labels` of values, in words, that have a unit and dimensions in common."""
    return {name: (unit, dims) for name in names.split()}


class Shown:
    """A base of dataclasses (`repr=False`) that are shown as a table of names, values and units."""

    #: By name: the unit, or the attribute that has it, and of an array its dimensions, in one word each; other values
    #: are ratios, counts, words. An array named as its one dimension is a coordinate. One with fewer dimensions has the
    #: last of them.
    labels: ClassVar[Mapping[str, tuple[str, str]]] = {}
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def unit_of(self, name: str) -> str:
        """Return the unit of a value; "1" of ratios and counts."""
        unit = self.labels.get(name, ("1", ""))[0]
        return str(getattr(self, unit, unit))

    def __repr__(self) -> str:
        rows = list(self._rows())
        width = max((len(name) for name, _ in rows), default=0)
        return "\n".join([type(self).__name__, *(f"  {name:<{width}}  {text}" for name, text in rows)])

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = (f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in self._rows())
        return f"<table><caption>{type(self).__name__}</caption>{''.join(rows)}</table>"

    def _names(self) -> list[str]:
        return list(dict.fromkeys([*self.__dataclass_fields__, *self.labels]))

    def _rows(self) -> Iterator[tuple[str, str]]:
        """Yield name and text of each value that there is."""
        for name in self._names():
            text, unit = _text(getattr(self, name)), self.unit_of(name)
            if text:
                yield name, text if unit in ("", "1") else f"{text} {unit}"


class Labelled(Shown):
    """The same, of numbers, text and arrays."""

    def to_xarray(self) -> Dataset:
        """Return an xarray Dataset: arrays by dimension and numbers, each with its `units`; text as attributes.

        Raises InputError where xarray is not installed.
        """
        with extras("to_xarray"):
            import xarray
        variables, texts = {}, {}
        for name in self._names():
            value, dims = getattr(self, name), self.labels.get(name, ("1", ""))[1].split()
            if isinstance(value, str):
                texts[name] = value
            elif isinstance(value, np.ndarray) and value.dtype.names:
                for column in value.dtype.names:
                    variables[f"{dims[0]}_{column}"] = dims, value[column], {"units": IMPACT[column]}
            elif isinstance(value, bool | int | float) or (isinstance(value, np.ndarray) and value.size):
                used = dims[len(dims) - np.ndim(value) :]
                variables[name] = used, value, {"units": self.unit_of(name), "long_name": _word(name)}
        coordinates = {name: variables.pop(name) for name in list(variables) if variables[name][0] == [name]}
        return xarray.Dataset(variables, coordinates, texts)


class Drawn(Labelled):
    """The same, with curves."""

    #: Arrays that `plot` draws, over their last dimension.
    drawn: ClassVar[tuple[str, ...]] = ()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curves in `ax`, or in a figure of its own; return the axes.

        Raises InputError where matplotlib is not installed.
        """
        with extras("plot"):
            from matplotlib import pyplot
        with pyplot.rc_context(style(LIGHT)):
            axes: Axes = pyplot.subplots(layout="constrained")[1] if ax is None else ax
            *_, over = self.labels[self.drawn[0]][1].split()
            for name in self.drawn:
                for label, curve in self._lines(name):
                    axes.plot(getattr(self, over), curve, label=label)
            axes.set_xlabel(f"{_word(over)} [{self.unit_of(over)}]")
            what = _word(self.drawn[0]) if len(self.drawn) == 1 else "displacement"
            axes.set_ylabel(f"{what} [{self.unit_of(self.drawn[0])}]")
            if len(axes.get_lines()) > 1:
                axes.legend()
        return axes

    def _lines(self, name: str) -> Iterator[tuple[str, Rows]]:
        """Yield a label and a curve (n,) for each place in the dimensions before the last."""
        values = getattr(self, name)
        dims = self.labels[name][1].split()[-values.ndim : -1]
        for place in np.ndindex(values.shape[:-1]):
            several = [(dim, k) for dim, k in zip(dims, place, strict=True) if len(getattr(self, dim)) > 1]
            at = (f"{_word(dim)} {getattr(self, dim)[k]:.4g}" for dim, k in several)
            yield ", ".join(at) or _word(name), values[place]


def _word(name: str) -> str:
    """Return what one value of an array is called."""
    return name.replace("_", " ").removesuffix("s")


def _text(value: object) -> str:
    """Return a value in short; empty where there is none."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        return f"{len(value)} rows of {', '.join(value.dtype.names)}"
    if isinstance(value, np.ndarray):
        numbers = np.abs(value) if np.iscomplexobj(value) else value
        finite = numbers[np.isfinite(numbers)] if value.dtype.kind in "biufc" else value[:0]
        return f"array {value.shape}" + (f", {finite.min():.4g} to {finite.max():.4g}" if finite.size else "")
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.6g}"
    if hasattr(value, "_repr_html_"):
        return type(value).__name__
    if isinstance(value, Mapping):  # of files and tables the names
        plain = all(isinstance(each, str | int | float) for each in value.values())
        return ", ".join(f"{key} {_text(each)}" if plain else str(key) for key, each in value.items())
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return ", ".join(map(_text, value))
    return "" if value is None else str(value.value if isinstance(value, Enum) else value)
