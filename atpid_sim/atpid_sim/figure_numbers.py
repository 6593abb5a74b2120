# SPDX-License-Identifier: Apache-2.0
"""Pictures that carry the numbers they show inside their PNG: so that a test can compare them with what is computed."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.output import writing
from atpid_sim.figure_style import LIGHT, style

#: Name of the PNG's text chunk.
KEY = "Numbers"
#: Title of each panel -> smallest, largest and mean x and y of each curve and bar chart in it.
Numbers = dict[str, list[list[float]]]


@contextmanager
def drawn(path: Path, option: str = "--out", dpi: int = 150, **layout: Any) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and the panels of matplotlib's `subplots`, with `mosaic` of `subplot_mosaic`; at the block's
    end the picture is written to `path`.

    Raises OutputError, which names the `option`, where that is not possible.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    make = pyplot.subplot_mosaic if "mosaic" in layout else pyplot.subplots
    with matplotlib.rc_context(style(LIGHT)):
        figure, panels = make(layout="constrained", **layout)
        yield figure, panels
        with writing(path, option):
            figure.savefig(path, dpi=dpi, metadata=metadata_of(figure))
    pyplot.close(figure)


def numbers_of(figure: Any) -> Numbers:
    """Return what a drawn matplotlib figure shows; not-finite values are left out."""
    titles = ["".join(axes.get_title(loc=place) for place in ("left", "center", "right")) for axes in figure.axes]
    return {f"{place} {title}": _panel(figure.axes[place]) for place, title in enumerate(titles)}


def metadata_of(figure: Any) -> dict[str, str]:
    """Return the `metadata` with which matplotlib's `savefig` keeps the numbers in the PNG."""
    return {KEY: json.dumps(numbers_of(figure), ensure_ascii=True)}


def numbers_in(picture: Path) -> Numbers:
    """Return the numbers kept in a PNG; raises ValueError for one without."""
    before, kind, after = picture.read_bytes().partition(f"tEXt{KEY}\0".encode())
    if not kind:
        raise ValueError(f"{picture}: no numbers inside; make it again with `make figures`")
    length = int.from_bytes(before[-4:], "big") - len(KEY) - 1  # of a chunk's content, which the kind follows
    numbers: Numbers = json.loads(after[:length])
    return numbers


def _panel(axes: Any) -> list[list[float]]:
    curves = [_summary(line.get_xdata()) + _summary(line.get_ydata()) for line in axes.get_lines()]
    charts = [container.patches for container in axes.containers if hasattr(container, "patches")]
    bars = [[bar.get_width(), bar.get_height()] for chart in charts for bar in chart]
    return curves + ([_summary(column) for column in np.transpose(bars)] if bars else [])


def _summary(values: Any) -> list[float]:
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    return [float(f"{value:.5g}") for value in (finite.min(), finite.max(), finite.mean())] if finite.size else []
