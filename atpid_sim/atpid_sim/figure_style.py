# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How every figure and page looks: the colours of a light and a dark scheme, and matplotlib's settings for one.

What is drawn as PNG and on a page is declared once, as panels: functions that draw into matplotlib axes. Pictures carry
the numbers they show inside their PNG, so that a test can compare them with what is computed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from atpid_common.output import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

#: Size of the text [points].
SIZE = 9.5
#: Width of a picture of the documentation [in]: its text is then 11 pixels high on a page of 700.
WIDTH = 8.4


@dataclass(frozen=True)
class Palette:
    """Colours of one scheme: grey for the given excitation and the closed damper, blue for the damper.

    Orange is kept for the thesis's printed figures and for warnings. The contrast of text is at least 4.5 to 1.
    """

    paper: str
    ink: str
    muted: str  # axes, captions
    grid: str
    given: str  # the closed damper, the true excitation, the command
    given_text: str  # the same where it is text
    own: str  # the damper, the estimate, the ceiling
    soft: str  # the same, as an area
    accent: str  # the thesis's figures, warnings
    window: str  # where a stage is measured
    green: str  # curves without a meaning of their own, after `own` and `accent`
    red: str
    violet: str


LIGHT = Palette(
    paper="#ffffff", ink="#1a1d21", muted="#5f6770", grid="#e7e9ec", given="#b4bac1", given_text="#6b727a",
    own="#0f6aa3", soft="#cfe3f0", accent="#b4540a", window="#f2f5f8",
    green="#2f7d4b", red="#b0304a", violet="#6f4fa0",
)  # fmt: skip
DARK = Palette(
    paper="#14171b", ink="#e9ebee", muted="#9aa2ab", grid="#2a2f36", given="#5b646e", given_text="#98a1ab",
    own="#62b2e6", soft="#1d3b50", accent="#eb9b57", window="#1b2026",
    green="#6cc08b", red="#ee7f95", violet="#b49be0",
)  # fmt: skip
#: Curves without a meaning of their own, in this order.
_CYCLE = (
    LIGHT.own, LIGHT.accent, LIGHT.green, LIGHT.red, LIGHT.violet, "#7a5c3e", "#c0468f", LIGHT.muted, "#93891c",
    "#1a8f9c",
)  # fmt: skip


def style(palette: Palette) -> Any:
    """Return matplotlib's settings for a palette."""
    return {
        "font.family": "DejaVu Sans", "font.size": SIZE, "axes.edgecolor": palette.grid, "axes.linewidth": 0.8,
        "axes.facecolor": palette.paper, "figure.facecolor": palette.paper, "savefig.facecolor": palette.paper,
        "axes.labelcolor": palette.muted, "text.color": palette.ink, "xtick.color": palette.muted,
        "ytick.color": palette.muted, "xtick.major.size": 0.0, "ytick.major.size": 0.0, "xtick.minor.size": 0.0,
        "ytick.minor.size": 0.0, "axes.grid": True, "grid.color": palette.grid, "grid.linewidth": 0.8,
        "axes.axisbelow": True, "axes.spines.top": False, "axes.spines.right": False, "axes.spines.left": False,
        "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.titlesize": SIZE + 0.5,
        "axes.prop_cycle": f"cycler(color={_CYCLE})", "legend.facecolor": palette.paper,
        "legend.edgecolor": "none", "legend.fontsize": SIZE - 1.5, "lines.solid_capstyle": "round",
    }  # fmt: skip


#: Name of the PNG's text chunk.
KEY = "Numbers"
#: Title of each panel -> smallest, largest and mean x and y of each curve and bar chart in it.
Numbers = dict[str, list[list[float]]]
#: Panels from top to bottom, one or two in a row: each draws into axes, and leaves its legend to `legend_below`.
Panels: TypeAlias = "Sequence[Sequence[Callable[[Axes], None]]]"
#: Characters of a name from which on a legend has one column, and of a line of a title in half a picture's width.
_LONG = 38
#: Characters of a name that a legend shows at most.
_LONGEST = 3 * _LONG


@contextmanager
def drawn(path: Path, option: str = "--out", dpi: int = 150, **layout: Any) -> Iterator[tuple[Figure, Any]]:
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


def save_panels(panels: Panels, path: Path, height: float = 3.4, dpi: int = 150) -> None:
    """Draw all panels in one PNG, each row `height` inches high. Raises OutputError."""
    names = [[f"{row} {min(column, len(each) - 1)}" for column in (0, 1)] for row, each in enumerate(panels)]
    with drawn(path, dpi=dpi, mosaic=names, figsize=(WIDTH, height * len(panels))) as (_, axes):
        for row, each in enumerate(panels):
            for column, draw in enumerate(each):
                panel = axes[f"{row} {column}"]
                draw(panel)
                panel.set_title(fill(panel.get_title(loc="left"), _LONG))
                legend_below(panel)


def legend_below(axes: Axes) -> None:
    """Draw the legend of what has a label below the axes and their label, where it hides no curve."""
    handles, names = axes.get_legend_handles_labels()
    if names:
        columns = 2 if max(map(len, names)) < _LONG else 1
        # a path may be as long as it likes: its end tells it from another
        shown = [fill(name if len(name) <= _LONGEST else f"…{name[1 - _LONGEST :]}", _LONG) for name in names]
        axes.legend(handles, shown, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=3.8, ncols=columns)


def logarithmic(axes: Axes) -> None:
    """Make the axis of ordinates logarithmic, with labels at 1, 2 and 5 in each decade."""
    axes.set_yscale("log")
    for formatted in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatted(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "125" else "")


def numbers_of(figure: Figure) -> Numbers:
    """Return what a drawn matplotlib figure shows; not-finite values are left out."""
    titles = ["".join(axes.get_title(loc=place) for place in ("left", "center", "right")) for axes in figure.axes]
    return {f"{place} {title}": _panel(figure.axes[place]) for place, title in enumerate(titles)}


def metadata_of(figure: Figure) -> dict[str, str]:
    """Return the `metadata` with which matplotlib's `savefig` keeps the numbers in the PNG."""
    return {KEY: json.dumps(numbers_of(figure), ensure_ascii=True)}


def _panel(axes: Axes) -> list[list[float]]:
    curves = [_summary(line.get_xdata()) + _summary(line.get_ydata()) for line in axes.get_lines()]
    charts = [container.patches for container in axes.containers if hasattr(container, "patches")]
    bars = [[bar.get_width(), bar.get_height()] for chart in charts for bar in chart]
    return curves + ([_summary(column) for column in np.transpose(bars)] if bars else [])


def _summary(values: ArrayLike) -> list[float]:
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    return [float(f"{value:.5g}") for value in (finite.min(), finite.max(), finite.mean())] if finite.size else []
