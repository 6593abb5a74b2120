# SPDX-License-Identifier: Apache-2.0
"""The points of a map: on this machine's cores, or on a Dask cluster that exists already."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

from atpid_sim.maps.height_map import MapError
from atpid_sim.maps.journal import Point
from atpid_sim.maps.quick import quick_best
from atpid_sim.maps.response import DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError
from atpid_sim.simulation.batch import Batch, Workers

#: A map is read between its points, so it stays in one well unless another is better by this share.
_HYSTERESIS = 0.15
#: A point and the fields of `Best` there; None, with `failure`, where a run fails.
Computed = tuple[Point, dict[str, Any]]


def on_cores(scene: Scene, points: list[Point], tolerance: float, workers: int | None) -> Iterator[Computed]:
    """Yield (point, values) as the threads of this process compute them; `workers`: how many, by default all cores."""
    return _batch(scene, points, tolerance).computed(Workers(workers))


def on_cluster(address: str, scene: Scene, points: Iterable[Point], tolerance: float) -> Iterator[Computed]:
    """Yield (point, values) as the workers of the scheduler at `address` deliver them; raises ClusterError."""
    return _batch(scene, list(points), tolerance).computed(Workers(cluster=address))


def _batch(scene: Scene, points: list[Point], tolerance: float) -> Batch[Point, dict[str, Any]]:
    dampers = {fraction: _damper(scene, fraction, tolerance) for fraction in {fraction for fraction, _ in points}}
    return Batch(lambda point: _values_at(dampers[point[0]], point[1]), points)


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
        return asdict(quick_best(damper, amplitude, _HYSTERESIS))
    except NumericalFailure as error:
        return {
            "height": None, "amplitude": None, "efficiency": None, "reproducible": False, "evaluations": 0,
            "failure": str(error),
        }  # fmt: skip
