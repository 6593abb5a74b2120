# SPDX-License-Identifier: Apache-2.0
"""The points of a map on a Dask cluster that exists already; optional, needs `dask[distributed]` on every machine.

The cluster owns scheduling and retries: a point whose worker dies is computed by another.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from typing import Any

from atpid_sim.maps.errors import MapError
from atpid_sim.maps.journal import Point
from atpid_sim.maps.point import values_at
from atpid_sim.maps.response import DamperResponse
from atpid_sim.scene import Scene, scene_from_mapping

#: How long a scheduler may take to answer [s].
_CONNECT_TIMEOUT = 10.0


def on_cluster(
    address: str, scene: Scene, points: Sequence[Point], tolerance: float, hysteresis: float
) -> Iterator[tuple[Point, dict[str, Any]]]:
    """Yield (point, values) as the workers of the scheduler at `address` deliver them.

    Raises MapError where dask is not installed, no scheduler answers, or a point fails on every worker that tried it.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise MapError(
            f"--scheduler: given {address}; no Dask scheduler answers there ({type(error).__name__}); "
            "start one with `dask scheduler`, or leave the option out"
        ) from None
    with client:
        mapping = scene.to_mapping()
        futures = {
            client.submit(point_of_map, mapping, point, tolerance, hysteresis, pure=False): point for point in points
        }
        for future in distributed.as_completed(list(futures), loop=client.loop):
            try:
                yield futures[future], future.result()
            except distributed.scheduler.KilledWorker:
                lost = f"--scheduler: every worker that computed {futures[future]} exited; see their logs"
                raise MapError(lost) from None


def point_of_map(mapping: dict[str, Any], point: Point, tolerance: float, hysteresis: float) -> dict[str, Any]:
    """Return one point (mass fraction, amplitude [m]) of the map of the scene in `mapping`; runs on a worker."""
    fraction, amplitude = point
    scene = scene_from_mapping(mapping, source="scene of the map").with_(mass_fraction=fraction)
    return values_at(DamperResponse(scene, tolerance), amplitude, hysteresis)


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise MapError("--scheduler needs Dask: pip install 'dask[distributed]', or leave the option out") from None
