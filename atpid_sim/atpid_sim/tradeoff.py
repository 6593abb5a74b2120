# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy on one scene: every fidelity level and tolerance against one converged reference."""

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation, sample_series
from atpid_sim.system import Array

#: Tolerance of the reference, and of the run it is checked against.
REFERENCE = 1e-12
CONTROL = 1e-11
#: Starting positions of an ensemble, relative disturbances.
_ENSEMBLE = tuple(float(d) for d in np.linspace(-1e-6, 1e-6, 64))
#: Points a period at which trajectories are compared.
_POINTS = 64
#: Runs whose median time counts.
REPEATS = 15
#: What is resting or slow at the level `finite` is integrated, at these tolerances.
FINITE = (1e-3, 1e-4, 1e-6)
SOFT = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9, 1e-10)
#: The fidelity levels.
LEVELS = ("soft", "finite", "impact", "simplified")


@dataclass(frozen=True)
class Point:
    """One method at one tolerance on one scene; errors relative to the reference's amplitude."""

    method: str
    tolerance: float  # for rk4 the step [s]
    time_s: float  # median, compiled, first call excluded; of the computing thread, so that other programs do not count
    amplitude: float  # [m]
    amplitude_error: float
    trajectory_error: float  # largest |dx_s| in the window over the amplitude
    energy_residual: float | None
    note: str
    front: bool = False


@dataclass(frozen=True)
class Reference:
    """The converged run: amplitude [m], how well two tolerances agree, the beam (n,) [m] at times (n,) [s]."""

    amplitude: float
    agreement: float
    spread: tuple[float, float, float] | None  # of an ensemble, where no tolerance reproduces the amplitude
    times: Array
    beam: Array


class TimedRun:
    """A scene at one fidelity and tolerance, ready to be timed."""

    def __init__(self, scene: Scene, fidelity: str, rtol: float) -> None:
        """Compile what it needs."""
        self._integration = Integration(scene, fidelity, rtol)
        self._integration.warm_up()

    def run(self, times: Array | None = None, disturbance: float = 0.0) -> tuple[float, Array, float, float]:
        """Return amplitude [m], the series at evenly spaced `times` (n,), the ledger's residual, the time taken [s]."""
        integration, window = self._integration, self._integration.scene.steady_window
        table, limit = integration.table, 10 * integration.step_limit
        if times is None:
            observation = Observation(window)
        else:
            observation = Observation(window, float(times[0]), float(times[1] - times[0]), sample_series(len(times)))
        begin = time.thread_time()
        run = integration.run(observation, table, limit, disturbance)
        wall = time.thread_time() - begin
        return run.last.amplitude, run.samples, run.ledger.residual, wall


def reference_of(scene: Scene) -> Reference:
    """Return the reference of a scene; two tolerances that disagree by a thousandth make it an ensemble.

    Raises SceneError where a controller moves the ceiling, NumericalFailure where the reference cannot be computed.
    """
    scene.require_prescribed_ceiling()
    begin, end = scene.steady_window
    count = int((end - begin) * scene.frequency_hz * _POINTS)
    times = begin + np.arange(count) * (end - begin) / count
    fidelity = complete_fidelity(scene)
    amplitude, series, _, _ = TimedRun(scene, fidelity, REFERENCE).run(times)
    other = TimedRun(scene, fidelity, CONTROL).run()[0]
    agreement = abs(other / amplitude - 1.0)
    spread = None
    if agreement > 1e-3:
        timed = TimedRun(scene, fidelity, 1e-7)
        values = sorted([amplitude, *(timed.run(None, d)[0] for d in _ENSEMBLE)])
        spread = values[0], statistics.median(values), values[-1]
    return Reference(amplitude, agreement, spread, times, series[columns.S_BEAM])


def levels(scene: Scene, reference: Reference) -> Iterator[Point]:
    """Yield a point of each fidelity level and tolerance that the scene has."""
    if complete_fidelity(scene) == "soft":
        for rtol in SOFT:
            yield _at_fidelity(scene, "soft", rtol, reference)
        for rtol in FINITE:
            yield _at_fidelity(scene, "finite", rtol, reference)
    yield _at_fidelity(scene, "impact", scene.tolerance, reference)
    yield _at_fidelity(scene, "simplified", scene.tolerance, reference)


def _at_fidelity(scene: Scene, fidelity: str, rtol: float, reference: Reference) -> Point:
    timed = TimedRun(scene, fidelity, rtol)
    try:
        amplitude, series, residual, wall = timed.run(reference.times)
    except NumericalFailure as error:
        return Point(fidelity, rtol, math.nan, math.nan, math.nan, math.nan, None, str(error))
    repeats = REPEATS if wall < 0.1 else 3
    wall = statistics.median(timed.run()[3] for _ in range(repeats))
    off = abs(amplitude / reference.amplitude - 1.0)
    away = apart(series[columns.S_BEAM], reference)
    return Point(fidelity, rtol, wall, amplitude, off, away, abs(residual), "")


def apart(beam: Array, reference: Reference) -> float:
    """Return the largest distance of a beam (n,) [m] from the reference's, over the amplitude."""
    length = min(len(beam), len(reference.beam))
    return float(np.max(np.abs(beam[:length] - reference.beam[:length]), initial=0.0)) / reference.amplitude


def with_front(points: Sequence[Point]) -> list[Point]:
    """Return the points with those marked that no other beats in both time and amplitude error."""

    def beaten(point: Point) -> bool:
        return any(
            q.time_s <= point.time_s and q.amplitude_error <= point.amplitude_error and q != point for q in points
        )

    return [replace(p, front=not beaten(p) and math.isfinite(p.amplitude_error)) for p in points]


def quickest(points: Sequence[Point], target: float) -> Point | None:
    """Return the quickest point within the target, whose method stays within it at every finer tolerance too."""
    return min((p for p in points if kept(p, points) <= target), key=lambda p: p.time_s, default=None)


def kept(point: Point, points: Sequence[Point]) -> float:
    """Return the largest error of a point and its method's finer ones; failed runs are ignored."""
    finer = (p.amplitude_error for p in points if p.method == point.method and p.tolerance < point.tolerance)
    return max([point.amplitude_error, *(error for error in finer if math.isfinite(error))])
