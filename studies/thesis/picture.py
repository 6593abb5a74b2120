# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a study: its panels, with the axes of the thesis's figures."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from atpid_sim.figure_style import WIDTH, drawn, legend_below
from studies.thesis.measured import Measured
from studies.thesis.points import Job, matches
from studies.thesis.study import Expected, Panel, Study


def draw(study: Study, jobs: Sequence[Job], measured: Sequence[Measured], path: Path) -> None:
    """Draw a study's panels into a PNG that carries its numbers. Raises OutputError."""
    columns = min(2, len(study.panels))
    rows = math.ceil(len(study.panels) / columns)
    size = (WIDTH / 2 * columns, 3.4 * rows)
    with drawn(path, dpi=100, nrows=rows, ncols=columns, figsize=size, squeeze=False) as (_, grid):
        for axes, panel in zip(grid.flat, study.panels, strict=False):
            shown = [(job, found) for job, found in zip(jobs, measured, strict=True) if matches(job.point, panel.at)]
            if panel.curve is not None:
                _curves(axes, panel, shown)
            else:
                _points(axes, panel, shown, study.rows)
            _finish(axes, panel)
        for axes in grid.flat[len(study.panels) :]:
            axes.set_visible(False)


def _curves(axes: Any, panel: Panel, shown: list[tuple[Job, Measured]]) -> None:
    """Draw one or several curves (names apart by spaces) of each point."""
    names = str(panel.curve).split()
    for job, found in shown:
        for name in names:
            x, y = found.curves[name]
            label = panel.label.format(**job.point) if len(names) == 1 else name.replace("_", " ")
            style = "o-" if len(x) < 40 else "-"
            axes.plot(x, y, style, markersize=3, linewidth=0.9, label=label or None)


def _points(axes: Any, panel: Panel, shown: list[tuple[Job, Measured]], rows: Sequence[Expected]) -> None:
    """Draw a quantity over a key of the sweep, a line for each label; the thesis's numbers as circles."""
    key, quantity = str(panel.x), str(panel.y)
    lines: dict[str, list[tuple[float, float]]] = {}
    for job, found in shown:
        if key in job.point and quantity in found.values:
            label = panel.label.format(**job.point)
            lines.setdefault(label, []).append((float(job.point[key]), float(found.values[quantity])))
    for label, points in lines.items():
        axes.plot(*zip(*sorted(points), strict=True), "o-", markersize=3, linewidth=1.0, label=label or None)
    printed = [(float(job.point[key]), value) for expected in rows if expected.quantity == quantity
               for job, value in _printed(expected, [job for job, _ in shown]) if key in job.point]  # fmt: skip
    if printed:
        axes.plot(*zip(*printed, strict=True), "ko", markersize=7, fillstyle="none", linestyle="", label="thesis")


def _printed(expected: Expected, jobs: list[Job]) -> list[tuple[Job, float]]:
    """Return the points for which the thesis prints a number."""
    found = [job for job in jobs if matches(job.point, expected.at)]
    values = expected.thesis if isinstance(expected.thesis, list) else [expected.thesis] * len(found)
    if expected.reduce is not None or len(values) != len(found):
        return []
    return [(job, float(value)) for job, value in zip(found, values, strict=True) if isinstance(value, float | int)]


def _finish(axes: Any, panel: Panel) -> None:
    axes.set(title=panel.title, xlabel=panel.xlabel, ylabel=panel.ylabel)
    axes.locator_params(axis="x", nbins=7)
    if panel.logarithmic:
        axes.set_yscale("log")
    if 0 < len(axes.get_legend_handles_labels()[0]) <= 9:
        legend_below(axes)
