# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One call for every baseline: a scene, a method by name, a tolerance; all results are measured alike.

Between the points of a motion it is interpolated from displacement, velocity and acceleration.
"""

import math
import time
from dataclasses import dataclass

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene
from atpid_sim.system import Array
from studies.baselines.methods import BASELINES
from studies.baselines.problem import BaselineError, Problem, problem_of, shortened
from studies.baselines.rhs import INPUT, WORK, mechanical_energy


@dataclass(frozen=True)
class BaselineResult:
    """Result of one baseline on one scene, in its steady window."""

    wall_s: float  # the integration alone, compiled; of the computing thread, so that other programs do not count
    steps: int
    evaluations: int  # of the right-hand side
    motion: Array  # in the window (4, n): time, rising [s], the beam's displacement [m], velocity, acceleration
    amplitude: float  # half peak-to-peak of the beam [m]
    energy_residual: float  # |gained - work done| over the support's work [-]
    escaped: bool  # whether the grain's centre was beyond a wall at a step
    message: str  # of the method; "" where it reports success

    def beam_at(self, times: Array) -> Array:
        """Return the beam's displacement (k,) [m] at `times` (k,) [s] within the window."""
        return between(times, *self.motion)


def run_baseline(scene: Scene, method: str, tolerance: float) -> BaselineResult:
    """Run `scene` by the `method` (a key of BASELINES) at a relative `tolerance` [-], for rk4 the step [s].

    The absolute tolerance is 1e-3 of the relative one, in SI units. The scene's controller is not run: a controlled
    ceiling stays closed. Raises BaselineError for an unknown method, or a law whose force is not one of overlap and
    velocity alone (impact, walton_braun).
    """
    if method not in BASELINES:
        raise BaselineError(f"method: given {method!r}; allowed: {', '.join(BASELINES)}")
    problem = problem_of(scene)
    run = BASELINES[method]
    run(shortened(problem), max(tolerance, 1e-6))  # compiles, or loads what was compiled
    begin = time.thread_time()
    solution = run(problem, tolerance)
    wall = time.thread_time() - begin
    every = np.vstack(solution.points) if solution.points else np.zeros((0, 5))
    _, first = np.unique(every[:, 0], return_index=True)
    motion = every[first].T[:4]
    sound = motion.shape[1] > 1 and np.isfinite(motion[1]).all()
    return BaselineResult(
        wall_s=wall,
        steps=solution.steps,
        evaluations=solution.evaluations,
        motion=motion,
        amplitude=half_peak_to_peak(*motion) if sound else math.nan,
        energy_residual=_residual(problem, solution.final),
        escaped=solution.escaped,
        message=solution.message,
    )


def _residual(problem: Problem, final: Array) -> float:
    first = drive.support_displacement(problem.rows, float(problem.rows[0, columns.START]))
    last = drive.support_displacement(problem.rows, float(problem.rows[-1, columns.END]))
    gained = mechanical_energy(final, last, problem.system) - mechanical_energy(problem.start, first, problem.system)
    given = abs(final[INPUT]) or mechanical_energy(problem.start, first, problem.system)
    return float(abs(gained - final[WORK]) / abs(given))


def between(at: Array, times: Array, x: Array, v: Array, a: Array) -> Array:
    """Return the displacement (k,) [m] at `at` (k,) [s] from x, v, a (n,) at rising `times` (n,), quintic in between.

    The error is h^6/46080 of the sixth derivative: 3e-10 of a sine with 40 points a period.
    """
    left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    h = times[left + 1] - times[left]
    s = (at - times[left]) / h
    r = 1.0 - s
    start = x[left] * (1.0 + s * (3.0 + 6.0 * s)) + h * (v[left] * s * (1.0 + 3.0 * s) + 0.5 * h * a[left] * s * s)
    end = x[left + 1] * (1.0 + r * (3.0 + 6.0 * r))
    end += h * (-v[left + 1] * r * (1.0 + 3.0 * r) + 0.5 * h * a[left + 1] * r * r)
    return np.asarray(start * r**3 + end * s**3)


def half_peak_to_peak(times: Array, x: Array, v: Array, a: Array) -> float:
    """Return half the distance [m] between the highest and the lowest displacement of the interpolated motion."""
    turning = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    low, high = times[turning].copy(), times[turning + 1].copy()
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    sign = np.where(v[turning] > 0.0, 1.0, -1.0)
    # one turning point lies in each bracket: golden section on all of them at once
    for _ in range(40):
        first, second = high - ratio * (high - low), low + ratio * (high - low)
        rising = sign * between(first, times, x, v, a) < sign * between(second, times, x, v, a)
        low, high = np.where(rising, first, low), np.where(rising, high, second)
    peaks = between(0.5 * (low + high), times, x, v, a) if len(turning) else np.empty(0)
    every = np.concatenate([x, peaks])
    return float(0.5 * (every.max() - every.min()))
