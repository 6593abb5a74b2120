# SPDX-License-Identifier: Apache-2.0
"""What `import atpid_sim as ap` offers: the functions of the commands, for programs and notebooks (docs/python.md).

Here as in scipy: `t_eval` are instants, `rtol` is the integrator's relative tolerance, `workers` how many threads.
Results have named values with units, `to_xarray()` and, where there are curves, `plot()`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from atpid_common.waiting import COMPILING, announced
from atpid_sim.outcome import NumericalFailure as NumericalFailure
from atpid_sim.scene import Scene as Scene
from atpid_sim.scene import SceneError as SceneError
from atpid_sim.scene import load_scene as load_scene
from atpid_sim.scene import scene_from_mapping as scene_from_mapping
from atpid_sim.scene import standard_bench as standard_bench

if TYPE_CHECKING:  # loaded by what needs them
    from atpid_sim.maps import Best, HeightMap
    from atpid_sim.periodic.motion import SteadySearch
    from atpid_sim.periodic.sweep import Sweep
    from atpid_sim.simulation.simulate import Result, Trajectory


def simulate(scene: Scene, *, fidelity: str = "auto", rtol: float | None = None, check: bool = True) -> Result:
    """Run a scene and return amplitude, efficiency, reduction, error estimate, energy ledger and impacts.

    check: repeat the run disturbed, which gives the error estimate and whether the amplitude is reproducible. Raises
    SceneError, and NumericalFailure where the run does not end as it should.
    """
    from atpid_sim.simulation import simulate as run

    _compile(scene)
    return run.simulate(scene, fidelity, rtol, check)


def trajectory(scene: Scene, t_eval: ArrayLike, *, fidelity: str = "auto", rtol: float | None = None) -> Trajectory:
    """Run a scene and return its motion at instants (n,) [s], evenly spaced, and its impacts; raises as `simulate`."""
    from atpid_sim.simulation import simulate as run

    _compile(scene)
    return run.trajectory(scene, np.asarray(t_eval, dtype=float), fidelity, rtol)


def steady_state(scene: Scene, *, fidelity: str = "auto", rtol: float | None = None) -> SteadySearch:
    """Solve for the steady motion that a scene ends in: `state`, or None and in `ending` why there is none."""
    from atpid_sim import periodic

    _compile(scene)
    return periodic.steady_state(scene, fidelity, rtol)


def sweep(
    scene: Scene,
    heights: ArrayLike,
    amplitudes: ArrayLike | None = None,
    mass_fractions: ArrayLike | None = None,
    *,
    fidelity: str = "auto",
    rtol: float | None = None,
    workers: int | None = None,
) -> Sweep:
    """Return the steady motions at heights (n,) [m], amplitudes (a,) [m or N] and mass fractions (m,) [-] at once.

    Each is the one that the scene's own run comes to. Raises as `simulate`; ValueError for heights that do not rise.
    """
    from atpid_sim.periodic import sweep as periodic
    from atpid_sim.simulation.batch import Workers

    _compile(scene)
    given = np.asarray(heights, dtype=float), _numbers(amplitudes), _numbers(mass_fractions)
    return periodic.sweep(scene, *given, fidelity, rtol, Workers(workers))


def best_height(
    scene: Scene,
    *,
    bounds: tuple[float, float] = (0.0, math.inf),
    rtol: float | None = None,
    workers: int | None = None,
) -> Best:
    """Return the best ceiling height for a scene's system and tone, the worst of all approach paths counting.

    bounds: lowest and highest height allowed [m]; rtol: by default as height maps have it. Raises as `simulate`.
    """
    from atpid_sim import maps
    from atpid_sim.simulation.batch import cores
    from atpid_sim.simulation.excitation import steady_amplitude

    amplitude = steady_amplitude(scene)
    _compile(scene)
    damper = maps.DamperResponse(scene, maps.map_tolerance(scene) if rtol is None else rtol)
    with ThreadPoolExecutor(workers or cores()) as pool:
        return maps.best_height(damper, amplitude, limits=bounds, mapper=pool.map)


def height_map(
    scene: Scene,
    amplitudes: ArrayLike,
    mass_fractions: ArrayLike | None = None,
    frequency_ratios: ArrayLike | None = None,
    *,
    out: str | PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> HeightMap:
    """Return the best heights over amplitudes (n,) [m or N], mass fractions (m,) [-] and frequency ratios (k,) [-].

    mass_fractions, frequency_ratios: by default the scene's own. out: a file to write it to, with a journal by which a
    run that was killed goes on. progress: called with points done and their number. Raises MapError, as `simulate`.
    """
    from atpid_sim import maps
    from atpid_sim.simulation.batch import Workers

    _compile(scene)
    fractions = _numbers(mass_fractions) or [scene.grain.mass_fraction]
    given = _numbers(amplitudes) or []
    return maps.build_map(scene, given, fractions, out, progress, Workers(workers), _numbers(frequency_ratios))


def load_map(path: str | PathLike[str]) -> HeightMap:
    """Return the height map in a file; raises MapError."""
    from atpid_sim.maps import HeightMap

    return HeightMap.load(path)


def compile_kernels() -> None:
    """Compile what the functions here need, once after an installation: a minute or two; the user's cache keeps it."""
    scene = standard_bench(ceiling={"height": 0.1}, duration=6.0)
    simulate(scene)
    steady_state(scene)
    sweep(scene, np.linspace(0.08, 0.12, 5))
    best_height(scene)


def _compile(scene: Scene) -> None:
    """Compile the engine for a scene, or load it from the cache, and say so where that takes long."""
    from atpid_sim.simulation.fidelity import complete_fidelity
    from atpid_sim.simulation.integration import Integration

    with announced(COMPILING):
        Integration(scene, complete_fidelity(scene)).warm_up()


def _numbers(values: ArrayLike | None) -> Sequence[float] | None:
    """Return numbers, one or several, as a list."""
    found: list[float] | None = None if values is None else np.atleast_1d(np.asarray(values, dtype=float)).tolist()
    return found
