# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulations a second: over heights with their impacts, over the points of a batch, and over workers.

python -m studies figures speed --out docs/figures
"""

import os
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from atpid_common import output
from atpid_sim.figure_style import WIDTH, drawn
from atpid_sim.simulation.batch import Workers, cores
from studies.sweep.measure import Sweep, standard_task, sweep

#: Levels measured, and the relative tolerance of their runs: the level `finite` is then within 1e-4.
_LEVELS, _RTOL = ("impact", "finite", "soft"), 1e-4
#: Heights [m], how many of them show the cost, sizes of the batches, and the batch that is given to some workers.
_LOWEST, _HIGHEST, _HEIGHTS, _SIZES, _MANY = 0.02, 0.4, 320, (16, 64, 256, 1024), 1000
#: Repetitions, of which the fastest counts: other programs only ever make a run slower.
_REPEATED = 3


class Speed(NamedTuple):
    """What was measured at one level: simulations a second by batch size and by workers, and the cost over heights."""

    sizes: list[float]
    workers: list[float]
    cost: Sweep


def run_of(count: int, fidelity: str, workers: int) -> Sweep:
    """Return the fastest of several sweeps over so many heights."""
    task = standard_task(0.01, 0.1, 0.2)
    runs = [sweep(task, _LOWEST, _HIGHEST, count, _RTOL, fidelity, workers=Workers(workers)) for _ in range(_REPEATED)]
    return min(runs, key=lambda each: each.wall_s)


@cache
def measured() -> dict[str, Speed]:
    """Return the speed at each level."""
    return {
        level: Speed(
            [size / run_of(size, level, cores()).wall_s for size in _SIZES],
            [_MANY / run_of(_MANY, level, workers).wall_s for workers in range(1, cores() + 1)],
            run_of(_HEIGHTS, level, 1),
        )
        for level in _LEVELS
    }


def table() -> str:
    """Return the speeds as a Markdown table."""
    load = f"load {os.getloadavg()[0]:.1f}"
    lines = [
        f"| level | {' | '.join(f'{size} points' for size in _SIZES)} | one worker | {cores()} workers, {load} |",
        "|---" * (len(_SIZES) + 3) + "|",
    ]
    for level, speed in measured().items():
        figures = [*speed.sizes, speed.workers[0], speed.workers[-1]]
        lines.append(f"| {level} | " + " | ".join(f"{figure:.0f}" for figure in figures) + " |")
    return "\n".join(lines)


def draw(out: Path) -> list[Path]:
    """Draw the three into the folder `out`; return the files written."""
    file = output.folder(out) / "speed.png"
    with drawn(file, mosaic=[["cost", "cost"], ["sizes", "workers"]], figsize=(WIDTH, 6.6)) as (_, panels):
        _cost(panels["cost"])
        _curves(panels["sizes"], "sizes", list(_SIZES), "points of the sweep")
        panels["sizes"].set(xscale="log")
        _curves(panels["workers"], "workers", list(range(1, cores() + 1)), "workers")
        panels["workers"].set_xticks(range(1, cores() + 1))
    return [file]


def _cost(axes: Any) -> None:
    for level, speed in measured().items():
        impacts, cost = speed.cost.impacts, 1e3 * speed.cost.integration_s
        order = np.argsort(impacts, kind="stable")
        axes.plot(impacts[order], cost[order], ".", markersize=4, label=level)
    title = "One run of 16 s, one worker"
    axes.set(xlabel="impacts", ylabel="integration [ms]", title=title, ylim=(0.0, None))
    axes.legend()


def _curves(axes: Any, name: str, places: list[int], label: str) -> None:
    for level, speed in measured().items():
        axes.plot(places, getattr(speed, name), "o-", markersize=4, label=level)
    axes.set(xlabel=label, ylabel="simulations a second", ylim=(0.0, None))
