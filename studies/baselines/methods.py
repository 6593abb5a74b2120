# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The methods themselves: scipy's, and Runge-Kutta pairs of our own where scipy has none."""

import math
import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.integrate import BDF, LSODA, RK45, ODEintWarning, OdeSolver, Radau, odeint

from atpid_sim.engine import columns
from atpid_sim.system import Array
from studies.baselines.problem import POINTS, BaselineError, Problem, Solution
from studies.baselines.rhs import slope
from studies.baselines.stepping import CASH_KARP, FEHLBERG, Tableau, adaptive_row, classical_row

#: Absolute over relative tolerance [m, m/s]: resolves an overlap of 0.1 mm as finely as a displacement of 0.1 m.
_ABSOLUTE = 1e-3
#: Step limits of a run: of compiled loops, and of loops that call back into Python.
_COMPILED_LIMIT = 50_000_000
_PYTHON_LIMIT = 1_000_000
#: Points the window may hold.
_CAPACITY = 4_000_000

Method = Callable[[Problem, float], Solution]


def _scipy(solver_class: type[OdeSolver], problem: Problem, rtol: float) -> Solution:
    """Integrate a problem by one of scipy's solvers, step by step as `solve_ivp` does, with a step limit."""
    solution = Solution([], problem.start.copy())
    # the last two states are integrals of the others: they must not control the step
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in problem.rows:
        q, length = problem.packed(row), float(row[columns.END] - row[columns.START])
        at = problem.instants(row)
        solver = solver_class(
            lambda tau, y, q=q: np.asarray(slope(tau, y, q)), 0.0, solution.final, length, rtol=rtol, atol=atol
        )
        times, states = ([0.0], [solution.final]) if len(at) else ([], [])
        while solver.status == "running" and solution.steps < _PYTHON_LIMIT:
            # implicit methods enlarge the increment of a state without effect until it overflows: harmless
            with np.errstate(over="ignore"):
                message = solver.step()
            solution.steps += 1
            solution.message = message or ""
            passed = at[(at > solver.t_old) & (at <= solver.t)] if len(at) else at
            if len(passed):
                dense = solver.dense_output()
                times += passed.tolist()
                states += [dense(t) for t in passed]
            solution.check_grain(problem, row, solver.t, solver.y)
        solution.evaluations += solver.nfev
        solution.final = solver.y.copy()
        if solver.status != "finished":
            solution.message = solution.message or f"stopped after {_PYTHON_LIMIT} steps"
            break
        if times:
            solution.keep(problem, row, _points(np.array(times), np.array(states).T, q), True)
    return solution


def _odeint(problem: Problem, rtol: float) -> Solution:
    solution = Solution([], problem.start.copy())
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in problem.rows:
        q, inside = problem.packed(row), problem.inside(row)
        at = problem.instants(row) if inside else np.array([0.0, row[columns.END] - row[columns.START]])
        with warnings.catch_warnings():
            # the warning repeats the message, which the result carries
            warnings.simplefilter("ignore", ODEintWarning)
            states, info = odeint(
                slope, solution.final, at, args=(q,), tfirst=True, rtol=rtol, atol=atol,
                mxstep=_PYTHON_LIMIT, full_output=True,
            )  # fmt: skip
        solution.steps += int(info["nst"][-1])
        solution.evaluations += int(info["nfe"][-1])
        if info["message"] != "Integration successful.":
            solution.message = str(info["message"])
            break
        solution.final = states[-1].copy()
        solution.keep(problem, row, _points(at, states.T, q), inside)
    return solution


def _points(tau: Array, states: Array, q: Array) -> Array:
    accelerations = [slope(t, state, q)[1] for t, state in zip(tau, states.T, strict=True)]
    return np.column_stack([q[columns.START] + tau, states[0], states[1], accelerations, states[2]])


def _embedded(tableau: Tableau, problem: Problem, rtol: float) -> Solution:
    y, h, solution = problem.start.copy(), 1e-3 * problem.period, Solution([], problem.start)
    for row in problem.rows:
        inside = problem.inside(row)
        longest = problem.period / POINTS if inside else math.inf
        kept = np.empty((_CAPACITY if inside else 0, 5))
        left = _COMPILED_LIMIT - solution.steps
        h, tried, fill = adaptive_row(problem.packed(row), tableau, rtol, _ABSOLUTE * rtol, longest, y, h, left, kept)
        solution.steps += tried
        solution.keep(problem, row, kept[:fill], inside)
        solution.check_grain(problem, row, float(row[columns.END] - row[columns.START]), y)
    solution.evaluations = solution.steps * len(tableau.weights)
    solution.message = "" if solution.steps < _COMPILED_LIMIT else f"stopped after {_COMPILED_LIMIT} steps"
    solution.final = y
    return solution


def _classical(problem: Problem, step: float) -> Solution:
    y, solution = problem.start.copy(), Solution([], problem.start)
    total = float(problem.rows[-1, columns.END] - problem.rows[0, columns.START]) / step
    if total > _COMPILED_LIMIT:
        raise BaselineError(f"step: given {step:g} s, {total:.3g} steps; allowed: at most {_COMPILED_LIMIT} steps")
    stride = max(1, int(problem.period / POINTS / step))
    for row in problem.rows:
        inside = problem.inside(row)
        kept = np.empty((_CAPACITY if inside else 0, 5))
        count, fill = classical_row(problem.packed(row), step, y, stride, kept)
        solution.steps += count
        solution.keep(problem, row, kept[:fill], inside)
        solution.check_grain(problem, row, float(row[columns.END] - row[columns.START]), y)
    solution.evaluations = 4 * solution.steps
    solution.final = y
    return solution


#: The methods the thesis compared (LSODE as LSODA, Rosenbrock as Radau) and others in common use. `odeint` is
#: LSODA too, through scipy's older interface, whose loop over the steps is compiled: the fastest LSODA scipy has.
BASELINES: dict[str, Method] = {
    "lsoda": partial(_scipy, LSODA),
    "odeint": _odeint,
    "rk45": partial(_scipy, RK45),
    "radau": partial(_scipy, Radau),
    "bdf": partial(_scipy, BDF),
    "cash_karp": partial(_embedded, CASH_KARP),
    "rkf45": partial(_embedded, FEHLBERG),
    "rk4": _classical,
}
