# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a comparison: efficiencies with their robustness, times to answer, structures that have changed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from atpid_sim.figure_numbers import drawn
from studies.methods.run import DETUNING, PASSIVE, SELECTED, Compared

#: Title of the panel whose numbers depend on the machine.
TIMES = "time to answer"
#: Of each curve: colour, style, width, and its name in the first panel with the place above (1) or below (-1) its end.
_CURVES = {
    "lookup": ("C0", "-", 1.3, "lookup", 1), "direct, margin": ("C2", "-", 1.3, "direct, margin", -1),
    PASSIVE[4]: ("0.75", "-", 3.6, "", 0), PASSIVE[5]: ("C3", ":", 1.6, "tuned masses", -1),
}  # fmt: skip
_WHAT = (*PASSIVE[1:], *SELECTED)


def draw(results: Sequence[Compared], path: Path) -> Path:
    """Draw the picture into a PNG that carries its numbers and return its path. Raises OutputError."""
    count = len(results)
    with drawn(path, dpi=110, nrows=2, ncols=count + 1, figsize=(3.9 * (count + 1), 8.4), squeeze=False) as (_, grid):
        for axes, one in zip(grid[0], results, strict=False):
            _efficiencies(axes, one)
        _times(grid[0][count], results)
        for axes, one in zip(grid[1], results, strict=False):
            _changed(axes, one, named=one is results[0])
        grid[1][count].axis("off")
        grid[1][count].legend(
            *grid[1][0].get_legend_handles_labels(), loc="center left", title="designed for the model"
        )
        for axes in grid[0][1:]:
            axes.set_yticklabels([])
        grid[1][0].set_ylabel("efficiency [%]")
    return path


def _rows(axes: Any) -> Any:
    axes.set_yticks(range(len(_WHAT)), _WHAT)
    axes.set_ylim(len(_WHAT) - 0.4, -0.6)
    axes.axhline(len(PASSIVE) - 1.5, color="k", linewidth=0.5)
    return enumerate(_WHAT)


def _efficiencies(axes: Any, one: Compared) -> None:
    """A dot for each amplitude, larger for the larger; a line down to the least on any structure."""
    sizes = 4.0 + 2.0 * np.argsort(np.argsort(one.amplitudes))
    for place, what in _rows(axes):
        nominal, every = 100.0 * one.nominal(what), 100.0 * one.efficiencies[what]
        if np.isnan(every).all():
            continue
        colour = "C7" if what in PASSIVE else "C0"
        axes.plot([np.nanmin(every), np.nanmax(every)], [place, place], color=colour, linewidth=2.0, alpha=0.5)
        for value, size in zip(nominal, sizes, strict=True):
            axes.plot([value], [place], "o", color=colour, markersize=size, alpha=0.8)
    axes.set_xlim(30.0, 100.0)
    axes.set_xlabel("efficiency [%]; line: with 5 % error of the model")
    axes.set_title(f"{one.name}\ngrain {100.0 * one.about['mass_fraction']:g} %", fontsize=10)


def _times(axes: Any, results: Sequence[Compared]) -> None:
    for place, what in _rows(axes):
        seconds = np.concatenate([one.seconds[what] for one in results]) if what in SELECTED else np.array([])
        if len(seconds):
            axes.plot([np.median(seconds), seconds.max()], [place, place], "C2", linewidth=2.0, alpha=0.5)
            axes.plot([np.median(seconds)], [place], "C2o")
    axes.set_xscale("log")
    axes.set_xlabel("[s]; dot: median, line: to the worst")
    axes.set_title(f"{TIMES}\n(search: of the structure)", fontsize=10)


def _changed(axes: Any, one: Compared, named: bool) -> None:
    for what, values in one.detuned.items():
        colour, style, width, name, side = _CURVES[what]
        axes.plot(DETUNING, 100.0 * values, style, color=colour, linewidth=width, label=what)
        if named:
            axes.annotate(name, (DETUNING[-1], 100.0 * values[-1]), xytext=(0, 4 * side), textcoords="offset points",
                          ha="right", va="bottom" if side > 0 else "top", color=colour)  # fmt: skip
    axes.axvline(1.0, color="k", linewidth=0.5)
    axes.set_xscale("log", base=2)
    axes.set_ylim(20.0, 100.0)
    axes.set_xlabel("stiffness over the model's [-]")
    axes.set_title(f"changed structure, support {1e3 * one.amplitudes[0]:g} mm", fontsize=10)
