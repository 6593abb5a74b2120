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
from atpid_sim.peers import stepping, tableaux
from atpid_sim.peers.rhs import slope
from atpid_sim.peers.task import POINTS, Array, PeerError, Task, Track

#: Absolute over relative tolerance [m, m/s]: resolves an overlap of 0.1 mm as finely as a displacement of 0.1 m asks.
_ABSOLUTE = 1e-3
#: Steps after which a peer is given up: compiled loops, and loops that call back into Python.
_BUDGET = 50_000_000
_PATIENCE = 1_000_000
#: Points the window may hold.
_ROOM = 4_000_000

Method = Callable[[Task, float], Track]


class _Instant(NamedTuple):
    """One state (6,) at a local time [s]."""

    time: float
    state: Array


def _scipy(name: str) -> Method:
    def run(task: Task, rtol: float) -> Track:
        return _run_scipy(task, _SOLVERS[name], rtol)

    return run


def _run_scipy(task: Task, solver_class: type[OdeSolver], rtol: float) -> Track:
    """Carry a task by one of scipy's solvers, step by step as `solve_ivp` does, but with an end to its patience."""
    track = Track([], task.start.copy())
    # the last two states only watch: they must not steer the step
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in task.rows:
        q, length = task.packed(row), float(row[columns.END] - row[columns.START])
        at = task.instants(row)
        solver = solver_class(partial(_slope_of, q), 0.0, track.final, length, rtol=rtol, atol=atol)
        found = [_Instant(0.0, track.final)] if len(at) else []
        while solver.status == "running" and track.steps < _PATIENCE:
            # the implicit methods widen the difference of a state that acts on nothing until it overflows: harmless
            with np.errstate(over="ignore"):
                said = solver.step()
            track.steps += 1
            track.message = said or ""
            passed = at[(at > solver.t_old) & (at <= solver.t)] if len(at) else at
            if len(passed):
                dense = solver.dense_output()
                found += [_Instant(float(t), dense(t)) for t in passed]
            track.watch(task, row, solver.t, solver.y)
        track.evaluations += solver.nfev
        track.final = solver.y.copy()
        if solver.status != "finished":
            track.message = track.message or f"gave up after {_PATIENCE} steps"
            break
        if found:
            states = np.array([instant.state for instant in found]).T
            track.keep(task, row, _points(np.array([instant.time for instant in found]), states, q), True)
    return track


def _slope_of(q: Array, tau: float, y: Array) -> Array:
    return np.asarray(slope(tau, y, q))


def _odeint(task: Task, rtol: float) -> Track:
    track = Track([], task.start.copy())
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in task.rows:
        q, inside = task.packed(row), task.inside(row)
        at = task.instants(row) if inside else np.array([0.0, row[columns.END] - row[columns.START]])
        with warnings.catch_warnings():
            # what it has to say is in its message, which the result carries
            warnings.simplefilter("ignore", ODEintWarning)
            states, told = odeint(
                slope, track.final, at, args=(q,), tfirst=True, rtol=rtol, atol=atol, mxstep=_PATIENCE, full_output=True
            )
        track.steps += int(told["nst"][-1])
        track.evaluations += int(told["nfe"][-1])
        if told["message"] != "Integration successful.":
            track.message = str(told["message"])
            break
        track.final = states[-1].copy()
        track.keep(task, row, _points(at, states.T, q), inside)
    return track


def _points(tau: Array, states: Array, q: Array) -> Array:
    accelerations = [slope(t, state, q)[1] for t, state in zip(tau, states.T, strict=True)]
    return np.column_stack([q[columns.START] + tau, states[0], states[1], accelerations, states[2]])


def _embedded(tableau: tableaux.Tableau) -> Method:
    def run(task: Task, rtol: float) -> Track:
        y, h, track = task.start.copy(), 1e-3 * task.period, Track([], task.start)
        for row in task.rows:
            inside = task.inside(row)
            longest = task.period / POINTS if inside else math.inf
            kept = np.empty((_ROOM if inside else 0, 5))
            h, tried, fill = stepping.adaptive_row(
                task.packed(row), *tableau, rtol, _ABSOLUTE * rtol, longest, y, h, _BUDGET - track.steps, kept, 0
            )
            track.steps += tried
            track.keep(task, row, kept[:fill], inside)
            track.watch(task, row, float(row[columns.END] - row[columns.START]), y)
        track.evaluations = track.steps * len(tableau.weights)
        track.message = "" if track.steps < _BUDGET else f"gave up after {_BUDGET} steps"
        track.final = y
        return track

    return run


def _classical(task: Task, step: float) -> Track:
    y, track = task.start.copy(), Track([], task.start)
    total = float(task.rows[-1, columns.END] - task.rows[0, columns.START]) / step
    if total > _BUDGET:
        raise PeerError(f"step: given {step:g} s, {total:.3g} steps; allowed: at most {_BUDGET} steps")
    stride = max(1, int(task.period / POINTS / step))
    for row in task.rows:
        inside = task.inside(row)
        kept = np.empty((_ROOM if inside else 0, 5))
        count, fill = stepping.classical_row(task.packed(row), step, y, stride, kept, 0)
        track.steps += count
        track.keep(task, row, kept[:fill], inside)
        track.watch(task, row, float(row[columns.END] - row[columns.START]), y)
    track.evaluations = 4 * track.steps
    track.final = y
    return track


_SOLVERS: dict[str, type[OdeSolver]] = {"LSODA": LSODA, "RK45": RK45, "Radau": Radau, "BDF": BDF}

#: The methods the thesis compared (LSODE as LSODA, Rosenbrock as Radau) and the usual ones beside them. `odeint` is
#: LSODA too, through scipy's older interface, whose loop over the steps is compiled: the fastest LSODA scipy has.
PEERS: dict[str, Method] = {
    "lsoda": _scipy("LSODA"),
    "odeint": _odeint,
    "rk45": _scipy("RK45"),
    "radau": _scipy("Radau"),
    "bdf": _scipy("BDF"),
    "cash_karp": _embedded(tableaux.CASH_KARP),
    "rkf45": _embedded(tableaux.FEHLBERG),
    "rk4": _classical,
}
