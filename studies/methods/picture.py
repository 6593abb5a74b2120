# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a comparison: efficiencies with their robustness, times to answer, structures that have changed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from atpid_sim.figure_style import WIDTH, drawn
from studies.methods.run import DETUNING, PASSIVE, SELECTED, Compared

#: Title of the panel whose numbers depend on the machine.
TIMES = "time to answer"
#: Of each curve: colour, style, width.
_CURVES = {
    "lookup": ("C0", "-", 1.3), "direct, margin": ("C2", "-", 1.3),
    PASSIVE[4]: ("0.75", "-", 3.6), PASSIVE[5]: ("C3", ":", 1.6),
}  # fmt: skip
_WHAT = (*PASSIVE[1:], *SELECTED)


def draw(results: Sequence[Compared], path: Path) -> Path:
    """Draw the picture into a PNG that carries its numbers and return its path. Raises OutputError."""
    rows = [[f"{what} {place}" for place in range(len(results))] for what in ("efficiencies", "changed")]
    mosaic = [*rows, ["times"] * len(results)]
    with drawn(path, mosaic=mosaic, figsize=(WIDTH, 9.0), height_ratios=(3.0, 3.0, 1.8)) as (figure, panels):
        for place, one in enumerate(results):
            _efficiencies(panels[f"efficiencies {place}"], one)
            _changed(panels[f"changed {place}"], one)
            if place:
                panels[f"efficiencies {place}"].set_yticklabels([])
        _times(panels["times"], results)
        panels["changed 0"].set_ylabel("efficiency [%]")
        names = panels["changed 0"].get_legend_handles_labels()
        figure.legend(*names, loc="outside lower center", ncols=4, title="designed for the model")
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
    axes.set_xlabel("efficiency [%]; line:\nwith 5 % error of the model")
    axes.set_title(f"{one.name}\ngrain {100.0 * one.about['mass_fraction']:g} %")


def _times(axes: Any, results: Sequence[Compared]) -> None:
    for place, what in _rows(axes):
        seconds = np.concatenate([one.seconds[what] for one in results]) if what in SELECTED else np.array([])
        if len(seconds):
            axes.plot([np.median(seconds), seconds.max()], [place, place], "C2", linewidth=2.0, alpha=0.5)
            axes.plot([np.median(seconds)], [place], "C2o")
    axes.set_ylim(len(_WHAT) - 0.4, len(PASSIVE) - 1.6)
    axes.set_xscale("log")
    axes.set_xlabel("[s]; dot: median, line: to the worst")
    axes.set_title(f"{TIMES}\n(search: of the structure)")


def _changed(axes: Any, one: Compared) -> None:
    for what, values in one.detuned.items():
        colour, style, width = _CURVES[what]
        axes.plot(DETUNING, 100.0 * values, style, color=colour, linewidth=width, label=what)
    axes.axvline(1.0, color="k", linewidth=0.5)
    axes.set_xscale("log", base=2)
    axes.set_ylim(20.0, 100.0)
    axes.set_xlabel("stiffness over the model's [-]")
    axes.set_title(f"changed structure,\nsupport {1e3 * one.amplitudes[0]:g} mm")
