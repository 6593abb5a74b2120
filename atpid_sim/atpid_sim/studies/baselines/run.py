# SPDX-License-Identifier: Apache-2.0
"""One call for every baseline: a scene, a method by name, a tolerance; all results are measured alike."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene
from atpid_sim.studies.baselines.methods import BASELINES
from atpid_sim.studies.baselines.problem import Array, BaselineError, Problem, Solution, problem_of, shortened
from atpid_sim.studies.baselines.rhs import INPUT, WORK, mechanical_energy
from atpid_sim.studies.peaks import between, half_peak_to_peak


@dataclass(frozen=True)
class BaselineResult:
    """Result of one baseline on one scene, in its steady window."""

    method: str
    tolerance: float  # relative tolerance [-]; for a fixed step, the step [s]
    wall_s: float  # the integration alone, compiled; of the computing thread, so that other programs do not count
    steps: int
    evaluations: int  # of the right-hand side
    times: Array  # (n,) rising, in the window [s]
    beam: Array  # displacement (n,) [m]
    beam_velocity: Array  # (n,) [m/s]
    beam_acceleration: Array  # (n,) [m/s^2]
    amplitude: float  # half peak-to-peak of the beam [m]
    energy_residual: float  # |gained - work done| over the support's work [-]
    escaped: bool  # whether the grain's centre was beyond a wall at a step
    message: str  # of the method; "" where it reports success

    def beam_at(self, times: Array) -> Array:
        """Return the beam's displacement (k,) [m] at `times` (k,) [s] within the window."""
        return between(times, self.times, self.beam, self.beam_velocity, self.beam_acceleration)


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
    return _result(problem, method, tolerance, wall, solution)


def _result(problem: Problem, method: str, tolerance: float, wall: float, solution: Solution) -> BaselineResult:
    every = np.vstack(solution.points) if solution.points else np.zeros((0, 5))
    _, first = np.unique(every[:, 0], return_index=True)
    times, x, v, a, _ = every[first].T
    amplitude = half_peak_to_peak(times, x, v, a) if len(times) > 1 and np.isfinite(x).all() else math.nan
    return BaselineResult(
        method=method,
        tolerance=tolerance,
        wall_s=wall,
        steps=solution.steps,
        evaluations=solution.evaluations,
        times=times,
        beam=x,
        beam_velocity=v,
        beam_acceleration=a,
        amplitude=amplitude,
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
