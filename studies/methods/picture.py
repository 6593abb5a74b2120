# SPDX-License-Identifier: Apache-2.0
"""The picture of a comparison: reductions with their robustness, times to answer, structures that have changed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from atpid_sim.figure_numbers import drawn, light_frames
from studies.methods.run import DETUNING, PASSIVE, SELECTED, Compared

#: Title of the panel whose numbers depend on the machine.
TIMES = "time to answer"
_COLOURS = {"lookup": "C0", "direct, margin": "C2", PASSIVE[4]: "C1", PASSIVE[5]: "C3"}
_WHAT = (*PASSIVE[1:], *SELECTED)


def draw(results: Sequence[Compared], path: Path) -> Path:
    """Draw the picture into a PNG that carries its numbers and return its path. Raises OutputError."""
    count = len(results)
    with drawn(path, dpi=110, nrows=2, ncols=count + 1, figsize=(3.9 * (count + 1), 8.4), squeeze=False) as (_, grid):
        light_frames(grid.flat)
        for axes, one in zip(grid[0], results, strict=False):
            _reductions(axes, one)
        _times(grid[0][count], results)
        for axes, one in zip(grid[1], results, strict=False):
            _changed(axes, one)
        grid[1][count].axis("off")
        grid[1][count].legend(
            *grid[1][0].get_legend_handles_labels(), loc="center left", title="designed for the model"
        )
        for axes in grid[0][1:]:
            axes.set_yticklabels([])
        grid[1][0].set_ylabel("reduction [%]")
    return path


def _rows(axes: Any) -> Any:
    axes.set_yticks(range(len(_WHAT)), _WHAT)
    axes.set_ylim(len(_WHAT) - 0.4, -0.6)
    axes.axhline(len(PASSIVE) - 1.5, color="k", linewidth=0.5)
    return enumerate(_WHAT)


def _reductions(axes: Any, one: Compared) -> None:
    """A dot for each amplitude, larger for the larger; a line down to the least on any structure."""
    sizes = 4.0 + 2.0 * np.argsort(np.argsort(one.amplitudes))
    for place, what in _rows(axes):
        nominal, every = 100.0 * one.nominal(what), 100.0 * one.reductions[what]
        if np.isnan(every).all():
            continue
        colour = "C7" if what in PASSIVE else "C0"
        axes.plot([np.nanmin(every), np.nanmax(every)], [place, place], color=colour, linewidth=2.0, alpha=0.5)
        for value, size in zip(nominal, sizes, strict=True):
            axes.plot([value], [place], "o", color=colour, markersize=size, alpha=0.8)
    axes.set_xlim(30.0, 100.0)
    axes.set_xlabel("reduction [%]; line: with 5 % error of the model")
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


def _changed(axes: Any, one: Compared) -> None:
    for what, values in one.detuned.items():
        style = "--" if what in PASSIVE else "-"
        axes.plot(DETUNING, 100.0 * values, style, color=_COLOURS[what], linewidth=1.3, label=what)
    axes.axvline(1.0, color="k", linewidth=0.5)
    axes.set_xscale("log", base=2)
    axes.set_ylim(20.0, 100.0)
    axes.set_xlabel("stiffness over the model's [-]")
    axes.set_title(f"changed structure, support {1e3 * one.amplitudes[0]:g} mm", fontsize=10)
