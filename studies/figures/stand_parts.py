# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the drawings of the stand share: axes without frame, blocks and wires."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from atpid_common.output import writing
from atpid_sim.figure_style import LIGHT, style

#: A place in a drawing of blocks.
Place = tuple[float, float]
#: Place of the lower left corner, width and height, title.
Block = tuple[float, float, float, float, str]
#: Points from block to block, what it is, a colour of the palette, and where the text begins.
Wire = tuple[tuple[Place, ...], str, str, Place]


@contextmanager
def drawing(path: Path, width: float, height: float) -> Iterator[Any]:
    """Yield axes in millimetres or blocks; at the end the picture is written, the same bytes each time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with matplotlib.rc_context(style(LIGHT) | {"svg.hashsalt": path.stem, "font.size": 9.0}):
        figure, ax = pyplot.subplots(figsize=(width, height), layout="constrained")
        ax.set_axis_off()
        ax.set_aspect("equal")
        yield ax
        with writing(path):
            figure.savefig(path, metadata={"Date": None, "Creator": None})
    pyplot.close(figure)


def wire(ax: Any, points: Iterable[Place], text: str, colour: str, at: Place) -> None:
    """Draw one wire with its text."""
    ax.plot(*zip(*points, strict=True), color=getattr(LIGHT, colour), lw=1.4, zorder=1)
    ax.text(*at, text, fontsize=8.0, va="bottom", zorder=3)


def block(ax: Any, x: float, y: float, width: float, height: float, text: str) -> None:
    """Draw one block with its title."""
    from matplotlib.patches import FancyBboxPatch

    shape = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.12",
                           fc=LIGHT.window, ec=LIGHT.ink, lw=0.9, zorder=2)  # fmt: skip
    ax.add_patch(shape)
    ax.text(x + 0.5 * width, y + 0.5 * height, text, ha="center", va="center", weight="bold", zorder=3)


def legend(ax: Any, y: float, *entries: tuple[float, str, str]) -> None:
    """Name the colours in one line; each with its x."""
    for x, words, colour in entries:
        ax.text(x, y, words, color=getattr(LIGHT, colour), weight="bold")
