# SPDX-License-Identifier: Apache-2.0
"""Make a map: every point by itself, on all cores, kept in a journal until the map is whole."""

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from atpid_sim.maps.cluster import on_cluster, on_cores
from atpid_sim.maps.height_map import FORMAT, Failure, HeightMap, MapError
from atpid_sim.maps.identity import identity_of
from atpid_sim.maps.journal import Journal, Point
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import rtol_of

Progress = Callable[[int, int], None]
#: Runs finer than this gain nothing: best heights are told apart by 0.2 % of the amplitude.
_FINEST = 1e-5


def build_map(
    scene: Scene,
    amplitudes: Sequence[float],
    mass_fractions: Sequence[float],
    out: str | os.PathLike[str],
    progress: Progress | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> HeightMap:
    """Return the map of a scene's system over support amplitudes [m] and mass fractions [-], both rising.

    It is written to `out`, and a run that was killed goes on where it stopped: points lie in a journal beside that
    file. `progress(done, total)` is called after each point. `scheduler` is the address of a Dask cluster to
    use instead of this machine's cores. A point whose runs fail is NaN in the map, with the reason in `failures`.
    Raises MapError, and NumericalFailure where every point fails.
    """
    wide, heavy = _rising(amplitudes, "amplitudes", 2), _rising(mass_fractions, "mass fractions", 1)
    identity, tolerance = identity_of(scene), map_tolerance(scene)
    purpose = {"format": FORMAT, "system": identity, "tolerance": tolerance}
    wanted: list[Point] = [(fraction, amplitude) for fraction in heavy for amplitude in wide]
    report = progress or (lambda *_: None)
    with closing(Journal(Path(out), purpose)) as journal:
        known = journal.points
        missing = [point for point in wanted if point not in known]
        report(len(wanted) - len(missing), len(wanted))
        if scheduler is None:
            computed = on_cores(scene, missing, tolerance, workers)
        else:
            computed = on_cluster(scheduler, scene, missing, tolerance)
        for point, values in computed:
            known[point] = values
            journal.record(point, values)
            report(sum(p in known for p in wanted), len(wanted))
        made = _assemble(wide, heavy, known, identity, tolerance)
        made.save(out)
        journal.finish()
    return made


def map_tolerance(scene: Scene) -> float:
    """Return the relative tolerance of the runs of a scene's map: that of the scene, but no finer than is of use."""
    return max(rtol_of(scene), _FINEST)


def _assemble(
    wide: list[float],
    heavy: list[float],
    known: dict[Point, dict[str, Any]],
    identity: dict[str, Any],
    tolerance: float,
) -> HeightMap:
    points = [(fraction, amplitude) for fraction in heavy for amplitude in wide]
    failures = tuple(Failure(*point, known[point]["failure"]) for point in points if "failure" in known[point])
    if len(failures) == len(points):
        raise NumericalFailure(f"none of the {len(points)} points of the map can be computed: {failures[0].reason}")

    def grid(name: str) -> Any:
        rows = [[known[(fraction, amplitude)][name] for amplitude in wide] for fraction in heavy]
        return np.array(rows, dtype=bool if name == "reproducible" else float)  # None becomes NaN

    return HeightMap(
        amplitudes=np.array(wide),
        mass_fractions=np.array(heavy),
        heights=grid("height"),
        beam_amplitudes=grid("amplitude"),
        efficiencies=grid("efficiency"),
        reproducible=grid("reproducible"),
        identity=identity,
        tolerance=tolerance,
        failures=failures,
    )


def _rising(values: Sequence[float], name: str, least: int) -> list[float]:
    numbers = [float(value) for value in values]
    if len(numbers) < least or not np.isfinite(numbers).all() or numbers[0] <= 0.0 or (np.diff(numbers) <= 0.0).any():
        given = ", ".join(f"{value:g}" for value in numbers[:4]) + (", ..." if len(numbers) > 4 else "")
        raise MapError(f"{name}: given {given}; allowed are at least {least} rising numbers above 0")
    return numbers
