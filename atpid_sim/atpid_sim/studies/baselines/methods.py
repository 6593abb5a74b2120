# SPDX-License-Identifier: Apache-2.0
"""The methods themselves: scipy's, and Runge-Kutta pairs of our own where scipy has none."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.integrate import BDF, LSODA, RK45, ODEintWarning, OdeSolver, Radau, odeint

from atpid_sim.engine import columns
from atpid_sim.studies.baselines import stepping, tableaux
from atpid_sim.studies.baselines.problem import POINTS, Array, BaselineError, Problem, Solution
from atpid_sim.studies.baselines.rhs import slope

#: Absolute over relative tolerance [m, m/s]: resolves an overlap of 0.1 mm as finely as a displacement of 0.1 m.
_ABSOLUTE = 1e-3
#: Step limits of a run: of compiled loops, and of loops that call back into Python.
_COMPILED_LIMIT = 50_000_000
_PYTHON_LIMIT = 1_000_000
#: Points the window may hold.
_CAPACITY = 4_000_000

Method = Callable[[Problem, float], Solution]


class _Instant(NamedTuple):
    """One state (6,) at a local time [s]."""

    time: float
    state: Array


def _scipy(name: str) -> Method:
    def run(problem: Problem, rtol: float) -> Solution:
        return _run_scipy(problem, _SOLVERS[name], rtol)

    return run


def _run_scipy(problem: Problem, solver_class: type[OdeSolver], rtol: float) -> Solution:
    """Integrate a problem by one of scipy's solvers, step by step as `solve_ivp` does, with a step limit."""
    solution = Solution([], problem.start.copy())
    # the last two states are integrals of the others: they must not control the step
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in problem.rows:
        q, length = problem.packed(row), float(row[columns.END] - row[columns.START])
        at = problem.instants(row)
        solver = solver_class(partial(_slope_of, q), 0.0, solution.final, length, rtol=rtol, atol=atol)
        found = [_Instant(0.0, solution.final)] if len(at) else []
        while solver.status == "running" and solution.steps < _PYTHON_LIMIT:
            # implicit methods enlarge the increment of a state without effect until it overflows: harmless
            with np.errstate(over="ignore"):
                message = solver.step()
            solution.steps += 1
            solution.message = message or ""
            passed = at[(at > solver.t_old) & (at <= solver.t)] if len(at) else at
            if len(passed):
                dense = solver.dense_output()
                found += [_Instant(float(t), dense(t)) for t in passed]
            solution.check_grain(problem, row, solver.t, solver.y)
        solution.evaluations += solver.nfev
        solution.final = solver.y.copy()
        if solver.status != "finished":
            solution.message = solution.message or f"stopped after {_PYTHON_LIMIT} steps"
            break
        if found:
            states = np.array([instant.state for instant in found]).T
            solution.keep(problem, row, _points(np.array([instant.time for instant in found]), states, q), True)
    return solution


def _slope_of(q: Array, tau: float, y: Array) -> Array:
    return np.asarray(slope(tau, y, q))


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
                slope,
                solution.final,
                at,
                args=(q,),
                tfirst=True,
                rtol=rtol,
                atol=atol,
                mxstep=_PYTHON_LIMIT,
                full_output=True,
            )
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


def _embedded(tableau: tableaux.Tableau) -> Method:
    def run(problem: Problem, rtol: float) -> Solution:
        y, h, solution = problem.start.copy(), 1e-3 * problem.period, Solution([], problem.start)
        for row in problem.rows:
            inside = problem.inside(row)
            longest = problem.period / POINTS if inside else math.inf
            kept = np.empty((_CAPACITY if inside else 0, 5))
            h, tried, fill = stepping.adaptive_row(
                problem.packed(row),
                *tableau,
                rtol,
                _ABSOLUTE * rtol,
                longest,
                y,
                h,
                _COMPILED_LIMIT - solution.steps,
                kept,
                0,
            )
            solution.steps += tried
            solution.keep(problem, row, kept[:fill], inside)
            solution.check_grain(problem, row, float(row[columns.END] - row[columns.START]), y)
        solution.evaluations = solution.steps * len(tableau.weights)
        solution.message = "" if solution.steps < _COMPILED_LIMIT else f"stopped after {_COMPILED_LIMIT} steps"
        solution.final = y
        return solution

    return run


def _classical(problem: Problem, step: float) -> Solution:
    y, solution = problem.start.copy(), Solution([], problem.start)
    total = float(problem.rows[-1, columns.END] - problem.rows[0, columns.START]) / step
    if total > _COMPILED_LIMIT:
        raise BaselineError(f"step: given {step:g} s, {total:.3g} steps; allowed: at most {_COMPILED_LIMIT} steps")
    stride = max(1, int(problem.period / POINTS / step))
    for row in problem.rows:
        inside = problem.inside(row)
        kept = np.empty((_CAPACITY if inside else 0, 5))
        count, fill = stepping.classical_row(problem.packed(row), step, y, stride, kept, 0)
        solution.steps += count
        solution.keep(problem, row, kept[:fill], inside)
        solution.check_grain(problem, row, float(row[columns.END] - row[columns.START]), y)
    solution.evaluations = 4 * solution.steps
    solution.final = y
    return solution


_SOLVERS: dict[str, type[OdeSolver]] = {"LSODA": LSODA, "RK45": RK45, "Radau": Radau, "BDF": BDF}

#: The methods the thesis compared (LSODE as LSODA, Rosenbrock as Radau) and others in common use. `odeint` is
#: LSODA too, through scipy's older interface, whose loop over the steps is compiled: the fastest LSODA scipy has.
BASELINES: dict[str, Method] = {
    "lsoda": _scipy("LSODA"),
    "odeint": _odeint,
    "rk45": _scipy("RK45"),
    "radau": _scipy("Radau"),
    "bdf": _scipy("BDF"),
    "cash_karp": _embedded(tableaux.CASH_KARP),
    "rkf45": _embedded(tableaux.FEHLBERG),
    "rk4": _classical,
}
