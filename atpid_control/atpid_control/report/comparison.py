# SPDX-License-Identifier: Apache-2.0
"""The same beam with the damper closed, simulated: the baseline of a report."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from atpid_control.report.run import Array, Run
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import is_closed
from atpid_sim.simulation.simulate import trajectory

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
