# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motion of a run as a file: a table (CSV), arrays (NPZ) or a picture (PNG)."""

from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.output import writing
from atpid_common.vocabulary import Drive
from atpid_sim.figure_numbers import drawn
from atpid_sim.scene import Scene
from atpid_sim.simulation.simulate import Trajectory

#: How many periods of the grain's motion the picture shows.
_PERIODS = 4.0


def write_series(motion: Trajectory, path: Path, drive: Drive) -> None:
    """Write the series (n,), SI, of what `drive` drives, as CSV with a header line or, with the impacts (k, 3), as NPZ.

    Raises OutputError.
    """
    # by the names that `excitation.series` and `calibrate beam` read
    columns: dict[str, Any] = {
        "time": motion.time,
        drive.channel: motion.support,
        "beam_displacement": motion.beam,
        "beam_velocity": motion.beam_velocity,
        "beam_acceleration": motion.beam_acceleration,
        "grain_displacement": motion.grain,
        "ceiling_height": motion.ceiling,
    }
    with writing(path, "--series"):
        if path.suffix.lower() == ".npz":
            with path.open("wb") as file:
                np.savez(file, impacts=motion.impacts, **columns)
        else:
            table = np.column_stack(list(columns.values()))
            np.savetxt(path, table, fmt="%.10g", delimiter=",", header=",".join(columns), comments="")


def draw(scene: Scene, motion: Trajectory, closed: Trajectory, path: Path) -> None:
    """Draw beam, ceiling and the grain's last periods; `closed`: the same beam, damper closed. Raises OutputError."""
    with drawn(path, "--picture", nrows=3, figsize=(10.0, 9.0), height_ratios=(3.0, 1.2, 2.2)) as (_, axes):
        _beam(axes[0], scene, motion, closed)
        axes[1].plot(motion.time, 1e3 * motion.ceiling, "C0", linewidth=1.4)
        axes[1].set(xlim=(0.0, scene.duration), ylim=(0.0, None))
        axes[1].set(ylabel="mm", xlabel="time [s]", title="Ceiling height")
        _grain(axes[2], scene, motion)


def _beam(axes: Any, scene: Scene, motion: Trajectory, closed: Trajectory) -> None:
    rest = scene.static_deflection
    axes.plot(closed.time, 1e3 * (closed.beam + rest), "0.7", linewidth=0.7, label="damper closed")
    axes.plot(motion.time, 1e3 * (motion.beam + rest), "C0", linewidth=0.8, label="this scene")
    axes.axvspan(*scene.steady_window, color="0.93", zorder=0, label="steady window")
    axes.set(xlim=(0.0, scene.duration), ylabel="mm", title="Beam displacement from rest")
    axes.legend(fontsize=8, loc="upper right")


def _grain(axes: Any, scene: Scene, motion: Trajectory) -> None:
    shown = motion.time >= motion.time[-1] - _PERIODS / scene.frequency_hz
    time = motion.time[shown]
    floor, grain = (1e3 * (one[shown] + scene.static_deflection) for one in (motion.beam, motion.grain))
    ceiling = floor + 1e3 * (motion.ceiling[shown] - 2.0 * scene.grain.radius)
    axes.plot(time, floor, "0.4", linewidth=1.2, label="floor")
    axes.plot(time, ceiling, "0.4", linewidth=1.2, linestyle="--", label="ceiling")
    axes.plot(time, grain, "C0", linewidth=1.8, label="grain")
    axes.set(xlim=(time[0], time[-1]), xlabel="time [s]", ylabel="mm", title="The grain between floor and ceiling")
    axes.legend(fontsize=8, loc="upper right")
