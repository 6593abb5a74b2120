# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy on one scene: every fidelity, method and tolerance against one converged reference."""

import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.periodic import steady_state
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.tradeoff import (
    CONTROL,
    LEVELS,
    REFERENCE,
    REPEATS,
    Point,
    Reference,
    TimedRun,
    apart,
    kept,
    levels,
    quickest,
)
from studies.baselines import BASELINES, BaselineError, BaselineResult, half_peak_to_peak, run_baseline

#: A method that took longer than this at one tolerance is not run at finer ones [s].
TIME_LIMIT = 5.0
#: Error at which the steady motion is compared with waiting for it, and share of it that the waiting run is given.
STEADY_ERROR, _SHARE = 1e-8, 0.1
#: By how much a waiting run is made longer, in times a disturbance takes to fall to 1/e, and how often.
_EXTENSION, _EXTENSIONS = 2.0, 15

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
#: Of scipy's LSODA: its solver class, as `solve_ivp` runs it, and its older, compiled loop.
LSODA = ("lsoda", "odeint")


@dataclass(frozen=True)
class Steady:
    """The steady motion: solved for, and waited for at the same fidelity."""

    amplitude: float  # [m]
    time_s: float
    error: float
    waited_time_s: float  # NaN: never as near
    waited_error: float
    waited_until: float  # duration of that run [s]


def measure(scene: Scene, reference: Reference, time_limit: float = TIME_LIMIT) -> Iterator[Point]:
    """Yield one point after another: the fidelity levels, then each baseline from loose to fine until too slow."""
    yield from levels(scene, reference)
    converged = TimedRun(scene, complete_fidelity(scene), REFERENCE)
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
    exact = steady_state(scene, fidelity, CONTROL).state
    if exact is None:
        return None

    def solved() -> tuple[float, float]:
        begin = time.thread_time()
        found = steady_state(scene, fidelity, STEADY_ERROR).state
        wall = time.thread_time() - begin
        return wall, math.inf if found is None else abs(found.amplitude / exact.amplitude - 1.0)

    error = solved()[1]
    wall = statistics.median(solved()[0] for _ in range(REPEATS))
    period = exact.periods / scene.frequency_hz
    for extended in range(_EXTENSIONS):
        end = scene.duration + extended * _EXTENSION * exact.settling_periods / scene.frequency_hz
        longer = scene.with_(duration=end, steady_window=[end - 2.0 * period, end])
        timed = TimedRun(longer, fidelity, _SHARE * STEADY_ERROR)
        off = abs(timed.run()[0] / exact.amplitude - 1.0)
        if off <= STEADY_ERROR:
            waited = statistics.median(timed.run()[3] for _ in range(REPEATS))
            return Steady(exact.amplitude, wall, error, waited, off, end)
    return Steady(exact.amplitude, wall, error, math.nan, off, end)


def answers(points: list[Point]) -> list[dict[str, Any]]:
    """Return what to run for amplitude errors of 1 %, 0.1 %, 1e-4, 1e-6, and how long scipy's LSODA takes for each."""
    return [_answer(points, target) for target in (1e-2, 1e-3, 1e-4, 1e-6)]


def tightest(points: list[Point]) -> list[dict[str, Any]]:
    """Return the same at the smallest error that both one of ours and `of`, one of scipy's two LSODA, meet."""
    ours = _best([p for p in points if p.method in LEVELS])
    best = {method: _best([p for p in points if p.method == method]) for method in LSODA}
    if ours is None:
        return []
    return [
        {"of": method} | _answer(points, max(ours, theirs)) for method, theirs in best.items() if theirs is not None
    ]


def _answer(points: list[Point], target: float) -> dict[str, Any]:
    ours = quickest([p for p in points if p.method in LEVELS], target)
    answer: dict[str, Any] = {"error": target, "run": None, "time_s": None}
    if ours is not None:
        answer |= {"run": f"{ours.method}, rtol {ours.tolerance:g}", "time_s": ours.time_s}
    for method in LSODA:
        found = [p for p in points if p.method == method]
        theirs = quickest(found, target)
        answer[method] = None if theirs is None else theirs.tolerance
        answer[f"{method}_time_s"] = None if theirs is None else theirs.time_s
        answer[f"{method}_ratio"] = None if ours is None or theirs is None else theirs.time_s / ours.time_s
        answer[f"{method}_best"] = _best(found)
    return answer


def _best(points: list[Point]) -> float | None:
    """Return the smallest error that a method meets; None where none gave a result."""
    return min((least for p in points if math.isfinite(least := kept(p, points))), default=None)


def _baseline(scene: Scene, method: str, tolerance: float, reference: Reference, converged: TimedRun) -> Point:
    result = run_baseline(scene, method, tolerance)
    walls = [result.wall_s]
    while len(walls) < 5 and sum(walls) < 0.5:
        walls.append(run_baseline(scene, method, tolerance).wall_s)
    note = result.message or ("grain left the container" if result.escaped else "")
    sound = result.motion.shape[1] > 1 and math.isfinite(result.amplitude)
    error = _error_as_read(result, reference, converged) if sound else math.nan
    away = apart(result.beam_at(reference.times), reference) if sound else math.nan
    wall = statistics.median(walls)
    return Point(method, tolerance, wall, result.amplitude, error, away, abs(result.energy_residual), note)


def _error_as_read(result: BaselineResult, reference: Reference, converged: TimedRun) -> float:
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
