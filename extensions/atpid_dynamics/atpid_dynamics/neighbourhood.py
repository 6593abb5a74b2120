# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Neighbourhoods of a stable periodic motion from which every state comes to it, and states that are followed there.

A neighbourhood is an ellipsoid of section states, in the metric in which the derivative of the return map contracts
(Lyapunov's equation), as large as its states still contract: on several shells the map itself is run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from atpid_dynamics.engine.basin_run import FAILED, follow_starts, neighbourhood_size
from atpid_sim.engine import columns
from atpid_sim.engine.sections import GRAIN, GRAIN_VELOCITY, MODES, MODES_VELOCITY, displaced_together
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.return_map import Conditions, passage
from atpid_sim.periodic.solve import PeriodicMotion, SteadyState, size_of
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

Counts = NDArray[np.int64]
#: Directions at least and per dimension, how many of them are tried first, and shells on which contraction is verified.
_DIRECTIONS, _PER_DIMENSION, _PROBES, _SHELLS = 48, 12, 8, (1.0, 0.6, 0.3)
#: The first radius over the motion's size, the factor between radii, how many are tried, and what is kept in reserve.
_RADIUS, _SMALLER, _RADII, _RESERVE = 0.5, 0.7, 30, 0.7
#: Half-widths of differences over the motion's size: of instantaneous impacts, of integrated contacts.
_EXACT, _INTEGRATED = 1e-6, 1e-4
#: Relative velocity over the motion's up to which a grain that never flies rests.
_RESTING = 0.01


class Cycle(NamedTuple):
    """A stable periodic motion where it passes a section."""

    phase: float  # of the section, as a share of a period
    state: State  # there, at time zero
    periods: int
    amplitude: float  # [m]
    multipliers: NDArray[np.complex128]  # (n,)
    settling_periods: float


class Flow:
    """What passes through periods of constant conditions that begin at one phase; counts the engine's steps."""

    def __init__(self, integration: Integration, conditions: Conditions, phase: float) -> None:
        """Prepare; phase: as a share of a period."""
        self.integration, self.conditions, self.phase = integration, conditions, phase
        self.period, self.steps = 1.0 / conditions.frequency, 0
        self.clearance = conditions.height - 2.0 * integration.system.radius
        self.places = integration.sections.places  # of a section state in the engine's

    def at(self, phase: float) -> Flow:
        """Return the same conditions from another phase on."""
        return Flow(self.integration, self.conditions, phase)

    @property
    def none(self) -> Array:
        """No neighbourhood (0, m), with as many numbers as each has."""
        return np.empty((0, neighbourhood_size(len(self.places))))

    def rows(self, shares: list[float]) -> Array:
        """Return the drive table of a period, cut at rising shares of it, of which the last is 1."""
        rows = np.zeros((len(shares), columns.DRIVE_COLUMNS))
        rows[:, columns.END] = np.array(shares) * self.period
        rows[1:, columns.START] = rows[:-1, columns.END]
        rows[:, columns.A0], rows[:, columns.OMEGA] = self.conditions.amplitude, 2.0 * math.pi / self.period
        rows[:, columns.PHASE] = rows[:, columns.START] * rows[:, columns.OMEGA] + 2.0 * math.pi * self.phase
        rows[:, columns.HEIGHT] = self.conditions.height
        return rows

    def follow(self, y: Array, n: Counts, most: int, places: Array, shares: Array) -> tuple[Counts, Array]:
        """Follow states in place, for `most` periods or to one of the neighbourhoods `places` (k, m).

        shares (k,): of the period, in (0, 1] and rising, where the places lie. Returns numbers of places, NOWHERE or
        FAILED, and the periods until there, infinite without one.
        """
        where, when = np.empty(len(y), dtype=np.int64), np.empty(len(y))
        every = np.concatenate([places, np.full((1, places.shape[1]), np.nan)])
        rows, limit = self.rows([*shares.tolist(), 1.0]), self.integration.step_limit
        run, sections = self.integration.kernel_inputs, self.integration.sections
        self.steps += follow_starts(run, sections, rows, every, y, n, most, limit, where, when)
        return where, when

    def passed(self, states: Array, like: State, periods: int) -> Array | None:
        """Return section states (k, n) so many periods later; None where one fails or not all touch a wall alike.

        like: a state of the motion, which tells whether the grain flies.
        """
        y, n = np.tile(like.y, (len(states), 1)), np.tile(like.n, (len(states), 1))
        self.integration.sections.enter(y, states)
        where, _ = self.follow(y, n, periods, self.none, np.empty(0))
        alike = (n[:, columns.MODE] == columns.FREE) == (like.mode == columns.FREE)
        return y[:, self.places] if alike.all() and not (where == FAILED).any() else None


def cycle_of(integration: Integration, conditions: Conditions, motion: SteadyState | PeriodicMotion) -> Cycle:
    """Return where a motion found passes a section, in flight where there is one. Raises NumericalFailure."""
    flying = integration.sections.flying
    phase, state = motion.phase, flying(motion.section)
    gap = state.grain - state.beam
    clearance = conditions.height - 2.0 * integration.system.radius
    if not 0.0 < gap < clearance:
        state.n[columns.MODE] = columns.ON_FLOOR if gap <= 0.5 * clearance else columns.ON_CEILING
        state.y[columns.DEEPEST] = max(-gap, gap - clearance)
        try:
            phase, section = passage(integration, conditions, state, phase, motion.periods)
            state = flying(section)
        except NumericalFailure:
            pass  # the grain never flies
    flow = Flow(integration, conditions, phase)
    for _ in range(motion.periods):  # overlaps, and what a wall remembers of them
        integration.advance_whole(state, flow.rows([1.0]))
        state.y[columns.TIME] = 0.0
    return Cycle(phase, state, motion.periods, motion.amplitude, motion.multipliers, motion.settling_periods)


def neighbourhoods(flow: Flow, cycle: Cycle) -> tuple[Array, float]:
    """Return a neighbourhood at each passage of the section (periods, m), and the least of their radii.

    flow: from the phase of the section on. The radius is that of the longest axis over the motion's size. There is none
    (0, m) where states do not contract.
    """
    state, scale = cycle.state.copy(), size_of(flow.integration, cycle.amplitude, flow.conditions)
    found, radii = np.empty((cycle.periods, flow.none.shape[1])), []
    for k in range(cycle.periods):
        ellipsoid = _ellipsoid(flow, state, cycle.periods, scale)
        if ellipsoid is None:
            return flow.none, 0.0
        metric, radius = ellipsoid
        found[k] = *state.y[flow.places], *metric.ravel(), float(state.mode != columns.FREE)
        radii.append(radius)
        flow.integration.advance(state, flow.rows([1.0]))
        state.y[columns.TIME] = 0.0
    return found, min(radii)


def _ellipsoid(flow: Flow, state: State, periods: int, scale: Array) -> tuple[Array, float] | None:
    """Return metric (n, n) and longest axis, over the motion's size, of the verified neighbourhood of a state."""
    touching = state.mode != columns.FREE
    basis = displaced_together(len(scale)) if touching else np.eye(len(scale))  # (d, n)
    basis = basis * scale[: len(basis), None]
    section, inverse = state.y[flow.places], np.linalg.pinv(basis)  # (n, d)
    count = len(basis)
    width = _EXACT if flow.integration.fidelity == "impact" else _INTEGRATED
    after = flow.passed(section + width * np.concatenate([basis, -basis]), state, periods)
    if after is None:
        return None
    slope = ((after[:count] - after[count:]) @ inverse / (2.0 * width)).T
    largest = float(np.abs(np.linalg.eigvals(slope)).max())
    if not largest < 1.0:
        return None
    rate = 0.5 * (1.0 + largest)
    form = solve_discrete_lyapunov((slope / rate).T, np.eye(count))
    ways = np.random.default_rng(0).normal(size=(max(_DIRECTIONS, _PER_DIMENSION * count), count))
    sphere = np.linalg.solve(np.linalg.cholesky(form).T, (ways / np.linalg.norm(ways, axis=1)[:, None]).T).T
    longest = 1.0 / math.sqrt(float(np.linalg.eigvalsh(form)[0]))
    radius, bound = _RADIUS / longest, (0.5 * (1.0 + rate)) ** 2

    def contract(shells: Array) -> bool:
        """Return whether displacements (k, d) of the present radius get shorter at a rate between 1 and `rate`."""
        moves = shells @ basis * radius
        gaps = state.grain - state.beam + moves[:, GRAIN] - moves[:, MODES].sum(axis=1)
        within = bool(((gaps > 0.0) & (gaps < flow.clearance)).all())
        after = flow.passed(section + moves, state, periods) if touching or within else None
        if after is None:
            return False
        ends = (after - section) @ inverse / radius
        return bool((_squares(ends, form) <= bound * _squares(shells, form)).all())

    for _ in range(_RADII):
        # a few first, which show what is much too large
        if contract(sphere[:_PROBES]) and all(contract(shell * sphere) for shell in _SHELLS):
            radius *= _RESERVE
            resting = np.zeros(len(scale))
            resting[MODES_VELOCITY], resting[GRAIN_VELOCITY] = -touching, touching
            resting /= _RESTING * scale[GRAIN_VELOCITY]
            return inverse @ form @ inverse.T / radius**2 + np.outer(resting, resting), radius * longest
        radius *= _SMALLER
    return None


def _squares(rows: Array, form: Array) -> Array:
    """Return the squares (k,) of rows (k, d) by a quadratic form (d, d)."""
    return np.asarray(((rows @ form) * rows).sum(axis=1))
