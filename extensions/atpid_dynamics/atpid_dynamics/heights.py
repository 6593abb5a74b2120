# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of a scene that differ in the height to which its ceiling goes last, as drive tables that begin alike."""

from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import drive_table
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
