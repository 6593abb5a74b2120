# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded run simulated again: with the damper closed, a report's baseline, and as recorded: is it reproducible?"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from atpid_control.runs.run import Run
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import is_closed
from atpid_sim.simulation.reproducibility import Verdict
from atpid_sim.simulation.simulate import trajectory, verdicts
from atpid_sim.system import Array

#: Displacement of the closed damper's beam (n,) [m] at given times (n,) [s].
Closed = Callable[[Scene, Array], Array]


def closed_height(scene: Scene) -> float:
    """Return the height of the closed damper [m]: the scene's own, else the grain's diameter."""
    return float(getattr(scene.ceiling, "closed", 2.0 * scene.grain.radius))


def closed_by_simulation(scene: Scene, times: Array) -> Array:
    """Simulate the scene with the ceiling held closed; return the beam's displacement (n,) [m] at `times` (n,) [s].

    Beam and grain as one mass where the ceiling touches the grain, as `simulate` takes it for `undamped_amplitude`.
    Raises NumericalFailure as `atpid_sim.simulation.simulate` does.
    """
    rate = max(scene.sensors.laser.rate, 100.0 * scene.frequency_hz)
    duration = max(scene.duration, float(times[-1]) + 1.0 / rate)
    held = scene.with_(height=closed_height(scene), duration=duration, steady_window=[0.0, duration])
    found = trajectory(held, rate, "simplified" if is_closed(held) else "auto")
    return np.asarray(np.interp(times, found.time, found.beam))


def closed_motion(run: Run, closed: Closed | None = None) -> Array | None:
    """Return the closed damper's beam (n,) [m] at the run's times; None without a scene or a simulation."""
    if run.scene is None:
        return None
    try:
        return (closed or closed_by_simulation)(run.scene, run.motion.time)
    except NumericalFailure:
        return None


#: A change of the ceiling's velocity below this is rounding [m a sample].
_KINK = 1e-9


def repeated(run: Run, windows: Sequence[tuple[float, float]]) -> list[Verdict | None]:
    """Return the verdict on each window (begin, end) [s] of a recorded run, which is simulated and repeated.

    None for each of a run that was not simulated, of one without a scene, and where the simulation fails.
    """
    nothing: list[Verdict | None] = [None] * len(windows)
    if run.truth is None or run.scene is None or not windows:
        return nothing
    changes: dict[str, Any] = {"duration": windows[-1][1], "steady_window": list(windows[-1])}
    if run.scene.ceiling.controlled:
        # the plant begins with its scene, whose samples a device may have taken some milliseconds later
        elapsed = run.truth.time - run.truth.time[0]
        times, heights = corners(elapsed, np.maximum(run.truth.ceiling, 2.0 * run.scene.grain.radius))
        changes["ceiling"] = {"profile": [[float(t), float(h)] for t, h in zip(times, heights, strict=True)]}
    try:
        return verdicts(run.scene.with_(**changes), windows)
    except NumericalFailure:
        return nothing


def corners(time: Array, height: Array) -> tuple[Array, Array]:
    """Return the points (k,) [s, m] between which a sampled height (n,) of piecewise constant velocity is straight."""
    bends = np.abs(np.diff(height, 2)) > _KINK
    kept = np.flatnonzero(np.concatenate(([True], bends, [True])))
    return time[kept], height[kept]
