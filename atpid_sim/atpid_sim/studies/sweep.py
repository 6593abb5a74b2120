# SPDX-License-Identifier: Apache-2.0
"""Many simulations of the thesis's range at once: how fast they go, and whether every ledger closes."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import simulate_many
from atpid_sim.simulation.simulate import Result


class Sweep(NamedTuple):
    """Results over heights (n,) [m], what it took, and the worst ledger."""

    heights: list[float]
    results: list[Result]
    wall_s: float
    residual: float  # largest, relative


def sweep(
    scene: Scene,
    lowest: float,
    highest: float,
    count: int,
    rtol: float | None = None,
    fidelity: str = "soft",
    progress: Callable[[int], None] | None = None,
) -> Sweep:
    """Simulate a scene at `count` heights [m], each once, on all cores.

    A ceiling that moves goes to the height in its last ramp, one that stands still stands there. `progress` is called
    with the number done after each. Raises SceneError
    where a controller moves the ceiling, ValueError for less than one height.
    """
    if count < 1:
        raise ValueError(f"count: given {count}; allowed: at least 1 height")
    heights = np.linspace(lowest, highest, count).tolist()
    scenes = [_opened(scene, height) for height in heights]
    simulate_many(scenes[:1], fidelity, rtol, check=False)  # compiles, or loads what was compiled
    begin = time.perf_counter()
    results = simulate_many(scenes, fidelity, rtol, check=False, progress=progress)
    wall = time.perf_counter() - begin
    return Sweep(heights, results, wall, max(abs(result.energy_residual) for result in results))


def _opened(scene: Scene, height: float) -> Scene:
    scene.require_prescribed_ceiling()
    if len(scene.ceiling.heights) == 1:
        return scene.with_(height=height)
    (_, closed), *_, (start, _), (end, _) = [(0.0, scene.ceiling.heights[0][1]), *scene.ceiling.heights[-2:]]
    return scene.with_(ceiling={"closed": closed, "open": height, "start": start, "end": end})


def standard_task(amplitude: float, fraction: float, height: float) -> Scene:
    """Return the standard bench for 16 s, closed until 6 s, open from 7 s on."""
    return standard_bench(
        grain={"mass_fraction": fraction, "radius": 0.0085},
        excitation={"amplitude": amplitude, "frequency": "resonance"},
        ceiling={"closed": 0.017, "open": height, "start": 6.0, "end": 7.0},
        steady_window=[14.0, 16.0],
    )
