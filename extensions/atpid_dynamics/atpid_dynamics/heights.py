# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of a scene that differ in the height to which its ceiling goes last, as drive tables that begin alike."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns, drive
from atpid_sim.engine.row_loop import integrate_alike
from atpid_sim.engine.state import State
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import Integration, closed_up_to, drive_table
from atpid_sim.system import Array


class HeightTables(NamedTuple):
    """Drive tables of runs at several heights."""

    widest: Scene  # at the largest height
    tables: Array  # (heights, rows, DRIVE_COLUMNS)
    common: int  # rows that all have alike, before the steady window


def tables_at(scene: Scene, heights: Array) -> HeightTables:
    """Return the drive tables of a scene at heights (n,) [m], to which its ceiling's last ramp leads.

    A ceiling that moves goes to the height in its last ramp, a fixed one is put there. Raises SceneError where a
    controller moves the ceiling.
    """
    widest = opened(scene, float(heights.max()))
    table = drive_table(widest, widest.steady_window)
    tables = np.repeat(table[None], len(heights), axis=0)
    *before, (end, _) = widest.ceiling.heights
    for each, height in zip(tables, heights.tolist(), strict=True):
        drive.enter_ceiling(each, [*before, (end, height)])
    alike = (tables == tables[0]).all(axis=(0, 2)) & (table[:, columns.END] <= widest.steady_window[0])
    return HeightTables(widest, tables, int(np.argmin(alike)) if not alike.all() else len(table))


def opened(scene: Scene, height: float) -> Scene:
    """Return the scene with its ceiling at a height [m] in the end; raises as `tables_at`."""
    scene.require_prescribed_ceiling()
    if len(scene.ceiling.heights) == 1:
        return scene.with_(height=height)
    (_, closed), *_, (start, _), (end, _) = [(0.0, scene.ceiling.heights[0][1]), *scene.ceiling.heights[-2:]]
    return scene.with_(ceiling={"closed": closed, "open": height, "start": start, "end": end})


def ends_alike(
    integration: Integration,
    first: State,
    tables: Array,
    common: int,
    sampling: tuple[float, float] = (0.0, 1.0),
    series: Array | None = None,
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return states (runs, m) and counters (runs, COUNTERS) in which runs of the scene end, and outcomes (runs,).

    Each goes through its own of `tables` (runs, rows, DRIVE_COLUMNS), which differ in the ceiling only, and only
    behind their first `common` rows, which lie before the steady window, where the beam's range is taken. Compiled,
    without the interpreter's lock. first: state in which they begin; sampling: first instant, not before the
    first `common` rows end, and period [s] of the samples in `series` (runs, SAMPLE_ROWS, n).
    """
    count, scene = len(tables), integration.scene
    y, n = np.tile(first.y, (count, 1)), np.tile(first.n, (count, 1))
    ends = tables[:, :, columns.HEIGHT] + tables[:, :, columns.CEILING_VELOCITY] * (
        tables[:, :, columns.END] - tables[:, :, columns.START]
    )
    highest = np.maximum(tables[:, :, columns.HEIGHT], ends).max(axis=1)
    masses = np.where(highest <= closed_up_to(scene), scene.total_mass, scene.beam.mass)
    outcomes = np.zeros(count, dtype=np.int64)
    series = np.empty((count, columns.SAMPLE_ROWS, 0)) if series is None else series
    alike, window, limit = common if (masses == masses[0]).all() else 0, scene.steady_window, integration.step_limit
    integrate_alike(integration.kernel_inputs, tables, alike, masses, y, n, window, sampling, series, limit, outcomes)
    return y, n, outcomes
