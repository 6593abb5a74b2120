# SPDX-License-Identifier: Apache-2.0
"""The numbers a picture shows, kept inside its PNG: so that a test can compare it with what is computed now."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

#: Name of the PNG's text chunk.
KEY = "Numbers"

#: Title of each panel -> smallest, largest and mean x and y of each curve and bar chart in it.
Numbers = dict[str, list[list[float]]]


def numbers_of(figure: Any) -> Numbers:
    """Return what a drawn matplotlib figure shows; not-finite values are left out."""
    return {f"{place} {_title(axes)}": _panel(axes) for place, axes in enumerate(figure.axes)}


def metadata_of(figure: Any) -> dict[str, str]:
    """Return the `metadata` with which matplotlib's `savefig` keeps the numbers in the PNG."""
    return {KEY: json.dumps(numbers_of(figure), ensure_ascii=True)}


def numbers_in(picture: Path) -> Numbers:
    """Return the numbers kept in a PNG; raises ValueError for one without."""
    text = dict(_texts(picture.read_bytes())).get(KEY)
    if text is None:
        raise ValueError(f"{picture}: no numbers inside; make it again with `make figures`")
    numbers: Numbers = json.loads(text)
    return numbers


def _texts(data: bytes) -> Iterator[tuple[str, str]]:
    """Return keys and values of the text chunks: length, type, content and check sum each."""
    place = 8
    while place + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        if kind == b"tEXt":
            key, _, value = data[place + 8 : place + 8 + length].decode("latin-1").partition("\0")
            yield key, value
        place += length + 12


def _title(axes: Any) -> str:
    return "".join(axes.get_title(loc=place) for place in ("left", "center", "right"))


def _panel(axes: Any) -> list[list[float]]:
    curves = [_summary(line.get_xdata()) + _summary(line.get_ydata()) for line in axes.get_lines()]
    charts = [container.patches for container in axes.containers if hasattr(container, "patches")]
    bars = [[bar.get_width(), bar.get_height()] for chart in charts for bar in chart]
    return curves + ([_summary(column) for column in np.transpose(bars)] if bars else [])


def _summary(values: Any) -> list[float]:
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    return [float(f"{value:.5g}") for value in (finite.min(), finite.max(), finite.mean())] if finite.size else []
