# SPDX-License-Identifier: Apache-2.0
"""Reproducibility of a simulated stage: the scene repeated with the ceiling as it was recorded."""

from __future__ import annotations

from typing import Any

import numpy as np

from atpid_control.report.run import Array, Run
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import ControlledCeiling, Scene
from atpid_sim.simulation.simulate import Result, simulate

#: A change of the ceiling's velocity below this is rounding [m a sample].
_KINK = 1e-9


def repeated(run: Run, begin: float, end: float) -> Result | None:
    """Return the simulation of a recorded run with the window (begin, end) [s]; it repeats itself to judge its result.

    None for a run that was not simulated, one without a scene, and where the simulation fails.
    """
    if not run.simulated or run.scene is None:
        return None
    try:
        return simulate(_as_recorded(run, run.scene, begin, end))
    except NumericalFailure:
        return None


def _as_recorded(run: Run, scene: Scene, begin: float, end: float) -> Scene:
    changes: dict[str, Any] = {"duration": end, "steady_window": [begin, end]}
    if isinstance(scene.ceiling, ControlledCeiling):
        times, heights = corners(run.motion.time, np.maximum(run.motion.ceiling, 2.0 * scene.grain.radius))
        changes["ceiling"] = {"profile": [[float(t), float(h)] for t, h in zip(times, heights, strict=True)]}
    return scene.with_(**changes)


def corners(time: Array, height: Array) -> tuple[Array, Array]:
    """Return the points (k,) [s, m] between which a sampled height (n,) of piecewise constant velocity is straight."""
    bends = np.abs(np.diff(height, 2)) > _KINK
    kept = np.flatnonzero(np.concatenate(([True], bends, [True])))
    return time[kept], height[kept]
