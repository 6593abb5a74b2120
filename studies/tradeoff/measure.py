# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy on one scene: every fidelity, method and tolerance against one converged reference."""

import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import steady_state
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation, sample_series
from atpid_sim.system import Array
from studies.baselines import BASELINES, BaselineError, BaselineResult, half_peak_to_peak, run_baseline

#: Tolerance of the reference, and of the run it is checked against.
REFERENCE = 1e-12
_CONTROL = 1e-11
#: Starting positions of an ensemble, relative disturbances.
_ENSEMBLE = tuple(float(d) for d in np.linspace(-1e-6, 1e-6, 64))
#: Points a period at which trajectories are compared.
_POINTS = 64
#: A method that took longer than this at one tolerance is not run at finer ones [s].
TIME_LIMIT = 5.0
_REPEATS = 15
#: Error at which the steady motion is compared with waiting for it, and share of it that the waiting run is given.
STEADY_ERROR, _SHARE = 1e-8, 0.1
#: By how much a waiting run is made longer, in times a disturbance takes to fall to 1/e, and how often.
_EXTENSION, _EXTENSIONS = 2.0, 15

#: What is resting or slow at the level `finite` is integrated, at these tolerances.
FINITE = (1e-3, 1e-4, 1e-6)
SOFT = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9, 1e-10)
BASELINE_TOLERANCES = {
    "odeint": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10),
    "lsoda": (1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    "rk45": (1e-4, 1e-6),
    "radau": (1e-4, 1e-6),
    "bdf": (1e-3, 1e-6),
    "cash_karp": (1e-4, 1e-6, 1e-8, 1e-10),
    "rkf45": (1e-4, 1e-6, 1e-8, 1e-10),
    "rk4": (1e-4, 3e-5, 1e-5, 3e-6),
}
#: Our fidelity levels, and scipy's LSODA: its solver class, as `solve_ivp` runs it, and its older, compiled loop.
OURS = ("soft", "finite", "impact", "simplified")
LSODA = ("lsoda", "odeint")


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


@dataclass(frozen=True)
class Steady:
    """The steady motion: solved for, and waited for at the same fidelity."""

    amplitude: float  # [m]
    time_s: float
    error: float
    waited_time_s: float  # NaN: never as near
    waited_error: float
    waited_until: float  # duration of that run [s]


class _Timed:
    """A scene at one fidelity and tolerance, ready to be timed."""

    def __init__(self, scene: Scene, fidelity: str, rtol: float) -> None:
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
    amplitude, series, _, _ = _Timed(scene, fidelity, REFERENCE).run(times)
    other = _Timed(scene, fidelity, _CONTROL).run()[0]
    agreement = abs(other / amplitude - 1.0)
    spread = None
    if agreement > 1e-3:
        timed = _Timed(scene, fidelity, 1e-7)
        values = sorted([amplitude, *(timed.run(None, d)[0] for d in _ENSEMBLE)])
        spread = values[0], statistics.median(values), values[-1]
    return Reference(amplitude, agreement, spread, times, series[columns.S_BEAM])


def measure(scene: Scene, reference: Reference, time_limit: float = TIME_LIMIT) -> Iterator[Point]:
    """Yield one point after another: the fidelity levels, then each baseline from loose to fine until too slow."""
    if complete_fidelity(scene) == "soft":
        for rtol in SOFT:
            yield _at_fidelity(scene, "soft", rtol, reference)
        for rtol in FINITE:
            yield _at_fidelity(scene, "finite", rtol, reference)
    yield _at_fidelity(scene, "impact", scene.tolerance, reference)
    yield _at_fidelity(scene, "simplified", scene.tolerance, reference)
    converged = _Timed(scene, complete_fidelity(scene), REFERENCE)
    for method in BASELINES:
        for tolerance in BASELINE_TOLERANCES[method]:
            try:
                point = _baseline(scene, method, tolerance, reference, converged)
            except BaselineError:
                return
            yield point
            if point.time_s > time_limit:
                break


def steady_trade(scene: Scene) -> Steady | None:
    """Return what solving for the steady motion takes beside waiting for it; None where a scene has none."""
    fidelity = complete_fidelity(scene)
    exact = steady_state(scene, fidelity, _CONTROL).state
    if exact is None:
        return None

    def solved() -> tuple[float, float]:
        begin = time.thread_time()
        found = steady_state(scene, fidelity, STEADY_ERROR).state
        wall = time.thread_time() - begin
        return wall, math.inf if found is None else abs(found.amplitude / exact.amplitude - 1.0)

    error = solved()[1]
    wall = statistics.median(solved()[0] for _ in range(_REPEATS))
    period = exact.periods / scene.frequency_hz
    for extended in range(_EXTENSIONS):
        end = scene.duration + extended * _EXTENSION * exact.settling_periods / scene.frequency_hz
        longer = scene.with_(duration=end, steady_window=[end - 2.0 * period, end])
        timed = _Timed(longer, fidelity, _SHARE * STEADY_ERROR)
        off = abs(timed.run()[0] / exact.amplitude - 1.0)
        if off <= STEADY_ERROR:
            waited = statistics.median(timed.run()[3] for _ in range(_REPEATS))
            return Steady(exact.amplitude, wall, error, waited, off, end)
    return Steady(exact.amplitude, wall, error, math.nan, off, end)


def with_front(points: list[Point]) -> list[Point]:
    """Return the points with those marked that no other beats in both time and amplitude error."""

    def beaten(point: Point) -> bool:
        return any(
            q.time_s <= point.time_s and q.amplitude_error <= point.amplitude_error and q != point for q in points
        )

    return [replace(p, front=not beaten(p) and math.isfinite(p.amplitude_error)) for p in points]


def answers(points: list[Point]) -> list[dict[str, Any]]:
    """Return what to run for amplitude errors of 1 %, 0.1 %, 1e-4, 1e-6, and how long scipy's LSODA takes for each."""
    return [_answer(points, target) for target in (1e-2, 1e-3, 1e-4, 1e-6)]


def tightest(points: list[Point]) -> list[dict[str, Any]]:
    """Return the same at the smallest error that both one of ours and `of`, one of scipy's two LSODA, meet."""
    ours = _best([p for p in points if p.method in OURS])
    best = {method: _best([p for p in points if p.method == method]) for method in LSODA}
    if ours is None:
        return []
    return [
        {"of": method} | _answer(points, max(ours, theirs)) for method, theirs in best.items() if theirs is not None
    ]


def _answer(points: list[Point], target: float) -> dict[str, Any]:
    ours = _quickest([p for p in points if p.method in OURS], target)
    answer: dict[str, Any] = {"error": target, "run": None, "time_s": None}
    if ours is not None:
        answer |= {"run": f"{ours.method}, rtol {ours.tolerance:g}", "time_s": ours.time_s}
    for method in LSODA:
        found = [p for p in points if p.method == method]
        theirs = _quickest(found, target)
        answer[method] = None if theirs is None else theirs.tolerance
        answer[f"{method}_time_s"] = None if theirs is None else theirs.time_s
        answer[f"{method}_ratio"] = None if ours is None or theirs is None else theirs.time_s / ours.time_s
        answer[f"{method}_best"] = _best(found)
    return answer


def _quickest(points: list[Point], target: float) -> Point | None:
    """Return the quickest point within the target, whose method stays within it at every finer tolerance too."""
    return min((p for p in points if _kept(p, points) <= target), key=lambda p: p.time_s, default=None)


def _best(points: list[Point]) -> float | None:
    """Return the smallest error that a method meets; None where none gave a result."""
    return min((kept for p in points if math.isfinite(kept := _kept(p, points))), default=None)


def _kept(point: Point, points: list[Point]) -> float:
    """Return the largest error of a point and its method's finer ones; failed runs are ignored."""
    finer = (p.amplitude_error for p in points if p.method == point.method and p.tolerance < point.tolerance)
    return max([point.amplitude_error, *(error for error in finer if math.isfinite(error))])


def _at_fidelity(scene: Scene, fidelity: str, rtol: float, reference: Reference) -> Point:
    timed = _Timed(scene, fidelity, rtol)
    try:
        amplitude, series, residual, wall = timed.run(reference.times)
    except NumericalFailure as error:
        return Point(fidelity, rtol, math.nan, math.nan, math.nan, math.nan, None, str(error))
    repeats = _REPEATS if wall < 0.1 else 3
    wall = statistics.median(timed.run()[3] for _ in range(repeats))
    off = abs(amplitude / reference.amplitude - 1.0)
    apart = _apart(series[columns.S_BEAM], reference)
    return Point(fidelity, rtol, wall, amplitude, off, apart, abs(residual), "")


def _baseline(scene: Scene, method: str, tolerance: float, reference: Reference, converged: _Timed) -> Point:
    result = run_baseline(scene, method, tolerance)
    walls = [result.wall_s]
    while len(walls) < 5 and sum(walls) < 0.5:
        walls.append(run_baseline(scene, method, tolerance).wall_s)
    note = result.message or ("grain left the container" if result.escaped else "")
    sound = result.motion.shape[1] > 1 and math.isfinite(result.amplitude)
    error = _error_as_read(result, reference, converged) if sound else math.nan
    apart = _apart(result.beam_at(reference.times), reference) if sound else math.nan
    wall = statistics.median(walls)
    return Point(method, tolerance, wall, result.amplitude, error, apart, abs(result.energy_residual), note)


def _error_as_read(result: BaselineResult, reference: Reference, converged: _Timed) -> float:
    """Return the amplitude's error, with the reference sampled as the baseline is.

    Between evenly spaced points a contact at the turn is interpolated over, which alone can cost 2e-6 of the amplitude:
    more than the error of many a baseline. So the converged run is sampled at the same points, and that error cancels.
    """
    times, *own_rows = result.motion[:, :-1]  # the last may end a shorter step
    if len(times) < 3 or not np.allclose(np.diff(times), times[1] - times[0], rtol=1e-6, atol=0.0):
        return abs(result.amplitude / reference.amplitude - 1.0)
    series = converged.run(times)[1]
    rows = series[[columns.S_BEAM, columns.S_VELOCITY, columns.S_ACCELERATION]]
    return abs(half_peak_to_peak(times, *own_rows) - half_peak_to_peak(times, *rows)) / reference.amplitude


def _apart(beam: Array, reference: Reference) -> float:
    """Return the largest distance of a beam (n,) [m] from the reference's, over the amplitude."""
    length = min(len(beam), len(reference.beam))
    return float(np.max(np.abs(beam[:length] - reference.beam[:length]), initial=0.0)) / reference.amplitude
