# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `import atpid_sim as ap` offers: what the commands call, for programs and notebooks (docs/python.md)."""

import functools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import entry_points
from typing import TypeVar, cast

from atpid_common.entry_points import loaded
from atpid_common.waiting import COMPILING, announced
from atpid_sim import maps, periodic
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene, scene_from_mapping, standard_bench
from atpid_sim.simulation import simulate as run
from atpid_sim.simulation.batch import cores
from atpid_sim.simulation.excitation import steady_amplitude
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration

__all__ = [
    "NumericalFailure", "Scene", "SceneError", "best_height", "compile_kernels", "height_map", "load_map", "load_scene",
    "scene_from_mapping", "simulate", "standard_bench", "steady_state", "trajectory",
]  # fmt: skip
#: The entry points by which an installed package has its kernels compiled: functions of a scene.
KERNELS = "atpid.kernels"
_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled_first(function: _Function) -> _Function:
    """Return a function that first compiles or loads the engine for its scene, and prints that where it takes long."""

    @functools.wraps(function)
    def called(scene: Scene, *args: object, **others: object) -> object:
        if not isinstance(scene, Scene):
            raise SceneError(f"scene: given {scene!r:.60}; allowed: a Scene, such as load_scene(path) returns")
        with announced(COMPILING):
            Integration(scene, complete_fidelity(scene)).warm_up()
        return function(scene, *args, **others)

    return cast(_Function, called)


simulate = compiled_first(run.simulate)
trajectory = compiled_first(run.trajectory)
steady_state = compiled_first(periodic.steady_state)
height_map = compiled_first(maps.build_map)
load_map = maps.HeightMap.load


@compiled_first
def best_height(
    scene: Scene,
    bounds: tuple[float, float] = (0.0, math.inf),
    rtol: float | None = None,
    workers: int | None = None,
) -> maps.Best:
    """Return the best ceiling height for a scene's system and tone, the worst of all approach paths counting.

    bounds: lowest and highest height allowed [m]; rtol: of the integrator, by default as height maps have it; workers:
    threads, by default one a core. Raises SceneError for another drive, NumericalFailure.
    """
    amplitude = steady_amplitude(scene)
    damper = maps.DamperResponse(scene, maps.map_tolerance(scene) if rtol is None else rtol)
    with ThreadPoolExecutor(workers or cores()) as pool:
        return maps.best_height(damper, amplitude, limits=bounds, mapper=pool.map)


def compile_kernels() -> None:
    """Compile what these functions and installed packages' need, once after an installation; the user's cache keeps it.

    That takes a minute or two.
    """
    scene = standard_bench(ceiling={"height": 0.1}, duration=6.0)
    simulate(scene)
    steady_state(scene)
    best_height(scene)
    for added in entry_points(group=KERNELS):
        loaded(added)(scene)
