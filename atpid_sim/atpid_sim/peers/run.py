# SPDX-License-Identifier: Apache-2.0
"""One call for every peer: a scene, a method by name, a tolerance; what comes back is measured alike."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import BDF, LSODA, RK45, ODEintWarning, OdeSolver, Radau, odeint

from atpid_sim.contact import Contact, contact_of
from atpid_sim.contact.ids import IMPACT, WALTON_BRAUN
from atpid_sim.engine import drive
from atpid_sim.excitation import support_rows
from atpid_sim.peaks import between, half_peak_to_peak
from atpid_sim.peers import stepping, tableaux
from atpid_sim.peers.rhs import mechanical_energy, pack, slope
from atpid_sim.scene import FreeExcitation, Scene
from atpid_sim.system import System, system_of

Array = NDArray[np.float64]

#: Points a period at which a motion is kept in the window; see `peaks.between` for the error that leaves.
_POINTS = 64
#: Absolute over relative tolerance [m, m/s]: resolves an overlap of 0.1 mm as finely as a displacement of 0.1 m asks.
_ABSOLUTE = 1e-3
#: Steps after which a peer is given up: compiled loops, and loops that call back into Python.
_BUDGET = 50_000_000
_PATIENCE = 1_000_000
#: Points the window may hold.
_ROOM = 4_000_000


class PeerError(ValueError):
    """A scene a peer cannot run."""


@dataclass(frozen=True)
class PeerResult:
    """What one peer made of one scene, in its steady window."""

    method: str
    tolerance: float  # relative tolerance [-]; for a fixed step, the step [s]
    wall_s: float  # the integration alone, compiled
    steps: int
    evaluations: int  # of the right-hand side
    times: Array  # (n,) rising, in the window [s]
    beam: Array  # displacement (n,) [m]
    beam_velocity: Array  # (n,) [m/s]
    beam_acceleration: Array  # (n,) [m/s^2]
    amplitude: float  # half peak-to-peak of the beam [m]
    energy_residual: float  # |gained - work done| over the support's work [-]
    escaped: bool  # whether the grain's centre was seen beyond a wall
    message: str  # "" where the method says it succeeded

    def beam_at(self, times: Array) -> Array:
        """Return the beam's displacement (k,) [m] at `times` (k,) [s] within the window."""
        return between(times, self.times, self.beam, self.beam_velocity, self.beam_acceleration)


@dataclass
class _Task:
    """A scene as arrays; the rows end where the drive has a kink and where the window begins and ends."""

    rows: Array
    system: System
    contact: Contact
    window: tuple[float, float]
    start: Array
    period: float

    def packed(self, row: Array) -> Array:
        """Return what the right-hand side needs in this row, (24,)."""
        return pack(row, self.system, self.contact)

    def instants(self, row: Array) -> Array:
        """Return the local times (n,) [s] at which a row in the window is looked at; none outside."""
        length = row[drive.END] - row[drive.START]
        return np.linspace(0.0, length, max(2, math.ceil(_POINTS * length / self.period)) if self.inside(row) else 0)

    def inside(self, row: Array) -> bool:
        """Whether a row lies in the window."""
        middle = 0.5 * (row[drive.START] + row[drive.END])
        return bool(self.window[0] <= middle <= self.window[1])


@dataclass
class _Track:
    """What a method leaves behind."""

    points: list[Array]  # each (n, 5): time, x, v, a, grain
    final: Array
    steps: int = 0
    evaluations: int = 0
    message: str = ""
    escaped: bool = False

    def watch(self, task: _Task, row: Array, tau: float, y: Array) -> None:
        """See whether the grain is still between the walls at local time tau [s]."""
        centre = y[2] - y[0] + task.system.radius
        self.escaped |= bool(centre < 0.0 or centre > row[drive.HEIGHT] + row[drive.HEIGHT_RATE] * tau)

    def keep(self, task: _Task, row: Array, points: Array, inside: bool) -> None:
        """Keep points (n, 5) of a row that lies in the window; watch the grain in all."""
        height = row[drive.HEIGHT] + row[drive.HEIGHT_RATE] * (points[:, 0] - row[drive.START])
        centre = points[:, 4] - points[:, 1] + task.system.radius
        self.escaped |= bool(np.any((centre < 0.0) | (centre > height)))
        if inside:
            self.points.append(points)


class _Instant(NamedTuple):
    """One state (6,) at a local time [s]."""

    time: float
    state: Array


_Method = Callable[[_Task, float], _Track]


def run_peer(scene: Scene, method: str, tolerance: float) -> PeerResult:
    """Run `scene` by the `method` (a key of PEERS) at a relative `tolerance` [-], for rk4 the step [s].

    The absolute tolerance is 1e-3 of the relative one, in SI units. The scene's controller is not run: a controlled
    ceiling stays closed. Raises PeerError for a method it does not know, or a law whose force is not one of overlap and
    rate alone (impact, walton_braun).
    """
    if method not in PEERS:
        raise PeerError(f"method: given {method!r}; allowed: {', '.join(PEERS)}")
    task = _task(scene)
    run = PEERS[method]
    run(_brief(task), max(tolerance, 1e-6))  # compiles, or loads what was compiled
    begin = time.perf_counter()
    track = run(task, tolerance)
    wall = time.perf_counter() - begin
    return _result(task, method, tolerance, wall, track)


def _task(scene: Scene) -> _Task:
    contact = contact_of(scene)
    if contact.law in (IMPACT, WALTON_BRAUN):
        raise PeerError(f"contact.law: given {scene.contact.law!r}; allowed: a law whose force needs no memory")
    rows = drive.with_ceiling(support_rows(scene), scene.ceiling.heights)
    window = scene.steady_window
    rows = drive.cut(rows, [t for t in window if 0.0 < t < rows[-1, drive.END]])
    start = np.zeros(6)
    released = scene.excitation.free.deflection if isinstance(scene.excitation, FreeExcitation) else 0.0
    start[[0, 2]] = released - scene.static_deflection
    fastest = max(2.0 * math.pi * scene.natural_frequency_hz, float(rows[:, drive.OMEGA].max()))
    return _Task(rows, system_of(scene), contact, window, start, 2.0 * math.pi / fastest)


def _brief(task: _Task) -> _Task:
    rows = task.rows[:1].copy()
    rows[0, drive.END] = rows[0, drive.START] + 1e-3 * task.period
    return _Task(rows, task.system, task.contact, (rows[0, 0], rows[0, 1]), task.start, task.period)


def _result(task: _Task, method: str, tolerance: float, wall: float, track: _Track) -> PeerResult:
    every = np.vstack(track.points) if track.points else np.zeros((0, 5))
    _, first = np.unique(every[:, 0], return_index=True)
    times, x, v, a, _ = every[first].T
    amplitude = half_peak_to_peak(times, x, v, a) if len(times) > 1 and np.isfinite(x).all() else math.nan
    return PeerResult(
        method=method,
        tolerance=tolerance,
        wall_s=wall,
        steps=track.steps,
        evaluations=track.evaluations,
        times=times,
        beam=x,
        beam_velocity=v,
        beam_acceleration=a,
        amplitude=amplitude,
        energy_residual=_residual(task, track.final),
        escaped=track.escaped,
        message=track.message,
    )


def _residual(task: _Task, final: Array) -> float:
    first = drive.support_displacement(task.rows, float(task.rows[0, drive.START]))
    last = drive.support_displacement(task.rows, float(task.rows[-1, drive.END]))
    gained = mechanical_energy(final, last, task.system) - mechanical_energy(task.start, first, task.system)
    given = abs(final[4]) or mechanical_energy(task.start, first, task.system)
    return float(abs(gained - final[5]) / abs(given))


def _scipy(name: str) -> _Method:
    def run(task: _Task, rtol: float) -> _Track:
        return _run_scipy(task, _SOLVERS[name], rtol)

    return run


def _run_scipy(task: _Task, solver_class: type[OdeSolver], rtol: float) -> _Track:
    """Carry a task by one of scipy's solvers, step by step as `solve_ivp` does, but with an end to its patience."""
    track = _Track([], task.start.copy())
    # the last two states only watch: they must not steer the step
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in task.rows:
        q, length = task.packed(row), float(row[drive.END] - row[drive.START])
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


def _odeint(task: _Task, rtol: float) -> _Track:
    track = _Track([], task.start.copy())
    atol = np.array([_ABSOLUTE * rtol] * 4 + [1e6] * 2)
    for row in task.rows:
        q, inside = task.packed(row), task.inside(row)
        at = task.instants(row) if inside else np.array([0.0, row[drive.END] - row[drive.START]])
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
    return np.column_stack([q[drive.START] + tau, states[0], states[1], accelerations, states[2]])


def _embedded(tableau: tableaux.Tableau) -> _Method:
    def run(task: _Task, rtol: float) -> _Track:
        y, h, track = task.start.copy(), 1e-3 * task.period, _Track([], task.start)
        for row in task.rows:
            inside = task.inside(row)
            longest = task.period / _POINTS if inside else math.inf
            kept = np.empty((_ROOM if inside else 0, 5))
            h, tried, fill = stepping.adaptive_row(
                task.packed(row), *tableau, rtol, _ABSOLUTE * rtol, longest, y, h, _BUDGET - track.steps, kept, 0
            )
            track.steps += tried
            track.keep(task, row, kept[:fill], inside)
        track.evaluations = track.steps * len(tableau.weights)
        track.message = "" if track.steps < _BUDGET else f"gave up after {_BUDGET} steps"
        track.final = y
        return track

    return run


def _classical(task: _Task, step: float) -> _Track:
    y, track = task.start.copy(), _Track([], task.start)
    stride = max(1, int(task.period / _POINTS / step))
    for row in task.rows:
        inside = task.inside(row)
        kept = np.empty((_ROOM if inside else 0, 5))
        count, fill = stepping.classical_row(task.packed(row), step, y, stride, kept, 0)
        track.steps += count
        track.keep(task, row, kept[:fill], inside)
    track.evaluations = 4 * track.steps
    track.final = y
    return track


_SOLVERS: dict[str, type[OdeSolver]] = {"LSODA": LSODA, "RK45": RK45, "Radau": Radau, "BDF": BDF}

#: The methods the thesis compared (LSODE as LSODA, Rosenbrock as Radau) and the usual ones beside them. `odeint` is
#: LSODA too, through scipy's older interface, whose loop over the steps is compiled: the fastest LSODA scipy has.
PEERS: dict[str, _Method] = {
    "lsoda": _scipy("LSODA"),
    "odeint": _odeint,
    "rk45": _scipy("RK45"),
    "radau": _scipy("Radau"),
    "bdf": _scipy("BDF"),
    "cash_karp": _embedded(tableaux.CASH_KARP),
    "rkf45": _embedded(tableaux.FEHLBERG),
    "rk4": _classical,
}
