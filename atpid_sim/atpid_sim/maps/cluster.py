# SPDX-License-Identifier: Apache-2.0
"""The points of a map: on this machine's cores, or on a Dask cluster that exists already."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

from atpid_sim.maps.best import best_height
from atpid_sim.maps.height_map import MapError
from atpid_sim.maps.journal import Point
from atpid_sim.maps.response import DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, scene_from_mapping
from atpid_sim.simulation import cluster
from atpid_sim.simulation.batch import on_all_cores

#: A map is read between its points, so it stays in one well unless another is better by this share.
_HYSTERESIS = 0.15
#: A point and the fields of `Best` there; None, with `failure`, where a run fails.
Computed = tuple[Point, dict[str, Any]]


def on_cores(scene: Scene, points: list[Point], tolerance: float, workers: int | None) -> Iterator[Computed]:
    """Yield (point, values) as the threads of this process compute them; `workers`: how many, by default all cores."""
    dampers = {fraction: _damper(scene, fraction, tolerance) for fraction in {fraction for fraction, _ in points}}
    return on_all_cores(lambda point: _values_at(dampers[point[0]], point[1]), points, workers)


def on_cluster(address: str, scene: Scene, points: Iterable[Point], tolerance: float) -> Iterator[Computed]:
    """Yield (point, values) as the workers of the scheduler at `address` deliver them; raises ClusterError."""
    mapping = scene.to_mapping()
    return cluster.on_cluster(address, _point_of_map, ((point, (mapping, point, tolerance)) for point in points))


def _point_of_map(mapping: dict[str, Any], point: Point, tolerance: float) -> dict[str, Any]:
    """Return one point of the map of the scene in `mapping`; runs on a worker."""
    scene = scene_from_mapping(mapping, source="scene of the map")
    return _values_at(_damper(scene, point[0], tolerance), point[1])


def _damper(scene: Scene, fraction: float, tolerance: float) -> DamperResponse:
    try:
        return DamperResponse(scene.with_(mass_fraction=fraction), tolerance)
    except SceneError as error:
        raise MapError(f"mass fraction {fraction:g}: {error}") from None


def _values_at(damper: DamperResponse, amplitude: float) -> dict[str, Any]:
    """Return the values at a support amplitude [m].

    One amplitude that cannot be simulated, as where the grain is pressed deeper into a wall than its radius, must not
    cost the others.
    """
    try:
        return asdict(best_height(damper, amplitude, _HYSTERESIS))
    except NumericalFailure as error:
        return {
            "height": None, "amplitude": None, "efficiency": None, "reproducible": False, "evaluations": 0,
            "failure": str(error),
        }  # fmt: skip
