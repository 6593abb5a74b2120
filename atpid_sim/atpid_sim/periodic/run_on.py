# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A scene run on at the fidelity asked for, its last excitation and ceiling staying, until its motion repeats itself.

This finds what the short way (`periodic.steady`) does not: motions of periods above two, those that come late, near
grazing, or whose transient ends elsewhere with tabulated contacts, and grains that never fly. Once strobes draw
together Newton's method goes the rest of the way from there. Where it has nothing to go by the run goes on until the
strobes are the same.
"""

import math

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns, drive
from atpid_sim.engine.sections import displaced_together
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.return_map import Conditions, ReturnMap, passage
from atpid_sim.periodic.solve import (
    Method,
    PeriodicMotion,
    SteadyEnding,
    SteadySearch,
    SteadyState,
    arrives,
    least_size,
    multipliers_at,
    size_of,
    solve,
    sorted_multipliers,
    tolerance_of,
)
from atpid_sim.results import named_impacts
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import (
    NO_OBSERVATION,
    SUPPORT,
    Integration,
    Observation,
    drive_table,
    impact_log,
    sample_series,
)
from atpid_sim.system import Array

#: Longest period looked for, periods run between looks, and the most that are run.
_LONGEST, _BLOCK, _MOST = 8, 40, 3200
#: Looks at the motion in each period of the support.
_LOOKS = 4
#: Strobes draw together when they are as near as this, relative to the motion's size, and have come nearer by this
#: factor over the last two blocks.
_NEAR, _NEARER = 1e-3, 0.9
#: Passages in which the run has to come nearer to a motion found, and how far it may be from it at first.
_PASSAGES, _FAR = 24, 0.1
#: Slightly disturbed runs that have to come to the same motion, how near its amplitude, and how far the first of them
#: may be from the run anywhere, over the motion's size, for the others not to be tried.
_REPEATED, _SAME, _TOGETHER = 8, 1e-3, 1e-3
#: Least disturbance of a drive, and periods more that a disturbed run may take.
_SLIGHT, _LATER = 1e-7, 2000
#: Tolerance with which a motion found is solved for once more.
_FINE = 1e-11
#: Half-width of differences of a motion without flight, relative to its size.
_WIDTH = 1e-4
#: Impacts a period that are logged.
_LOG = 200


def rows_until(scene: Scene, end: float) -> Array:
    """Return the drive table of a scene up to `end` [s]."""
    if scene.frequency_moves:
        whole = drive_table(scene, (end,))
        return whole[whole[:, columns.END] <= end]
    # kinks of the ceiling as points of the amplitude: rows need not be cut
    times, amplitudes = zip(*scene.excitation.amplitude_points, strict=True)
    edges = sorted({0.0, end, *(t for t in (*times, *(t for t, _ in scene.ceiling.heights)) if t < end)})
    points = list(zip(edges, np.interp(edges, times, amplitudes).tolist(), strict=True))
    rows = drive.harmonic_rows(points, scene.frequency_hz, end)
    drive.enter_ceiling(rows, scene.ceiling.heights)
    return rows


def next_period(row: Array, period: float) -> Array:
    """Return the row (1, DRIVE_COLUMNS) of the period [s] after one of constant conditions, from time zero on."""
    following = row[None].copy()
    following[0, columns.PHASE] += row[columns.OMEGA] * (row[columns.END] - row[columns.START])
    following[0, columns.START], following[0, columns.END] = 0.0, period
    return following


class _Run:
    """The run, period by period."""

    def __init__(
        self, scene: Scene, integration: Integration, conditions: Conditions, still: float, disturbance: float = 0.0
    ) -> None:
        """Run to a whole period behind the last kink at `still` [s]; disturbance: of the drive until then, relative."""
        self.integration, self.conditions = integration, conditions
        self.period = 1.0 / conditions.frequency
        self.begin = self.period * (math.ceil(still / self.period - 1e-9) + 1)
        rows = rows_until(scene, self.begin)
        self._row = next_period(rows[-1], self.period)
        if disturbance != 0.0:
            rows[:, SUPPORT] *= 1.0 + disturbance
        self.state, self.done, self.amplitude = integration.initial_state(), 0, 0.0
        integration.advance_whole(self.state, rows)

    @property
    def phase(self) -> float:
        """Of the strobes, as a share of a period."""
        return float(self._row[0, columns.PHASE] / (2.0 * math.pi)) % 1.0

    @property
    def followed(self) -> float:
        """How much was run [s]."""
        return self.begin + self.done * self.period

    def go_on(self, periods: int) -> Array:
        """Run so many periods on; return the looks at them (periods, looks * 3) [m]."""
        series = sample_series(_LOOKS * periods)
        self.passed(self.state, periods, Observation((0.0, periods * self.period), 0.0, self.period / _LOOKS, series))
        self.done += periods
        self.amplitude = self.state.amplitude
        pace = 2.0 * math.pi * self.conditions.frequency
        seen = np.stack([series[columns.S_BEAM], series[columns.S_VELOCITY] / pace, series[columns.S_GRAIN]], axis=1)
        looks: Array = seen.reshape(periods, 3 * _LOOKS)
        return looks

    def passed(self, state: State, periods: int, observation: Observation) -> None:
        """Advance a state at the phase of the strobes, in place, by so many periods. Raises NumericalFailure."""
        row = self._row.copy()
        row[0, columns.END] = periods * self.period
        state.y[columns.TIME] = 0.0
        state.restart_observation()
        state.restart_steps()
        self.integration.advance_whole(state, row, observation)


def run_on(
    scene: Scene, integration: Integration, conditions: Conditions, still: float, known: float, slight: float
) -> SteadySearch:
    """Run a scene until its motion repeats itself, and return that motion.

    still: when its last kink is [s]; known: relative error that stays; slight: disturbance of the drive that must not
    lead to another motion. Raises NumericalFailure where the run does not go on.
    """
    run = _Run(scene, integration, conditions, still)
    seen = np.concatenate([run.go_on(_BLOCK), run.go_on(_BLOCK)])
    while run.done < _MOST:
        seen = np.concatenate([seen, run.go_on(_BLOCK)])
        for periods in range(1, _LONGEST + 1):
            found = _found(run, seen, periods, known)
            if found is None:
                continue
            if _by_chance(scene, run, seen, found.amplitude, still, max(slight, _SLIGHT)):
                return SteadySearch(SteadyEnding.BY_CHANCE)
            return SteadySearch(SteadyEnding.FOUND, found)
    return SteadySearch(SteadyEnding.IRREGULAR)


def _found(run: _Run, seen: Array, periods: int, known: float) -> SteadyState | None:
    """Return the motion of so many periods that the run comes to; None where it is not seen to, or not yet."""
    recent = seen[-2 * _BLOCK - periods :] / max(run.amplitude, least_size(run.integration, run.conditions))
    moved = np.abs(recent[periods:] - recent[:-periods]).max(axis=1)
    quarters = moved.reshape(4, -1).max(axis=1)
    if quarters[2:].max() <= tolerance_of(run.integration):
        return _waited(run, _least_period(recent, periods, 10.0 * tolerance_of(run.integration)), known)
    if quarters[3] <= _NEAR and quarters[3] <= _NEARER * quarters[0]:
        return _solved(run, periods, known)
    return None


def _least_period(recent: Array, periods: int, same: float) -> int:
    """Return the least divisor of a number of periods after which recent strobes (n, k) are the same."""
    for fewer in range(1, periods):
        if periods % fewer == 0 and np.abs(recent[fewer:] - recent[:-fewer])[-_BLOCK:].max() <= same:
            return fewer
    return periods


def _solved(run: _Run, periods: int, known: float) -> SteadyState | None:
    """Return the stable motion that Newton's method finds near the run, and that the run comes nearer to."""
    try:
        phase, section = passage(run.integration, run.conditions, run.state, run.phase, periods)
    except NumericalFailure:
        return None
    returns = ReturnMap(run.integration, run.conditions, phase, periods)
    motion = solve(returns, section).motion
    if motion is None or motion.stability_margin <= 0.0:
        return None
    scale = size_of(run.integration, motion.amplitude, run.conditions)
    passages = np.concatenate([section[None], returns.passages(section, _PASSAGES)])
    apart = np.abs((passages - motion.section) / scale).max(axis=1)
    if len(passages) <= _PASSAGES or apart[0] > _FAR:
        return None
    if run.integration.scene.modes is not None and not arrives(
        returns, section, motion.section, scale, motion.largest_multiplier
    ):
        return None
    half = len(apart) // 2
    if not apart[half:].max() <= max(apart[:half].max(), tolerance_of(run.integration)):
        return None
    return _described(run, _finer(run, motion), known)


def _finer(run: _Run, motion: PeriodicMotion) -> PeriodicMotion:
    """Return the same motion over the least number of periods after which it repeats itself, integrated finely.

    Multipliers near grazing are smooth only in runs that repeat themselves to rounding.
    """
    fine = run.integration.at_level(run.integration.fidelity, min(run.integration.rtol, _FINE))
    for periods in range(1, motion.periods + 1):
        if motion.periods % periods == 0:
            found = solve(ReturnMap(fine, run.conditions, motion.phase, periods), motion.section).motion
            if found is None or found.stability_margin <= 0.0:
                continue
            scale = size_of(run.integration, motion.amplitude, run.conditions)
            apart = np.abs((found.section - motion.section) / scale).max()
            if apart <= 10.0 * tolerance_of(run.integration) / found.stability_margin:
                return found
    return motion


def _waited(run: _Run, periods: int, known: float) -> SteadyState | None:
    """Return the motion that the run repeats; solved for once more where the grain flies, for its multipliers."""
    solved = _solved(run, periods, known)
    if solved is not None:
        return solved
    log = impact_log(_LOG * periods)
    state = run.state.copy()
    run.passed(state, periods, Observation((0.0, periods * run.period), impacts=log))
    multipliers = _multipliers(run, periods, state.amplitude)
    largest = float(abs(multipliers[0]))
    if largest >= 1.0:
        return None
    section, impacts = run.state.y[run.integration.sections.places], log[: state.n[columns.IMPACTS]]
    error = known + tolerance_of(run.integration) / (1.0 - largest)
    found = state.amplitude, error, periods, multipliers, run.followed, section, run.phase
    return SteadyState(*found, named_impacts(impacts), run.integration.fidelity, Method.WAITED)


def _multipliers(run: _Run, periods: int, amplitude: float) -> NDArray[np.complex128]:
    """Return the multipliers (n,) of the motion that the run repeats; of a grain that never flies two are zero."""
    try:
        phase, section = passage(run.integration, run.conditions, run.state, run.phase, periods)
        returns = ReturnMap(run.integration, run.conditions, phase, periods)
        return multipliers_at(returns, section, size_of(run.integration, amplitude, run.conditions))
    except NumericalFailure:
        return np.concatenate([sorted_multipliers(_slope_without_flight(run, periods, amplitude)), np.zeros(2)])


def _slope_without_flight(run: _Run, periods: int, amplitude: float) -> Array:
    """Return the derivative (n - 2, n - 2) of structure and grain displaced together, as they move while in contact."""
    sections, scale = run.integration.sections, size_of(run.integration, amplitude, run.conditions)
    together = displaced_together(len(scale))
    slope = np.empty((len(together), len(together)))
    for column, displaced in enumerate(together):
        ends = []
        for sign in (1.0, -1.0):
            state = run.state.copy()
            sections.enter(state.y, state.y[sections.places] + sign * _WIDTH * scale[column] * displaced)
            run.passed(state, periods, NO_OBSERVATION)
            ends.append(state.y[sections.places[:-2]])
        slope[:, column] = (ends[0] - ends[1]) / (2.0 * _WIDTH * scale[column])
    return slope


def _described(run: _Run, motion: PeriodicMotion, known: float) -> SteadyState:
    error, impacts = known + motion.residual / motion.stability_margin, named_impacts(motion.impacts)
    found = motion.amplitude, error, motion.periods, motion.multipliers, run.followed, motion.section, motion.phase
    return SteadyState(*found, impacts, run.integration.fidelity, Method.LONG)


def _by_chance(scene: Scene, run: _Run, seen: Array, amplitude: float, still: float, slight: float) -> bool:
    """Return whether runs whose drive is slightly disturbed come to a motion of another amplitude [m]."""
    off = abs(run.amplitude - amplitude)
    for number, part in enumerate(np.linspace(-1.0, 1.0, _REPEATED).tolist()):
        other = _Run(scene, run.integration, run.conditions, still, slight * part)
        beside = np.concatenate([other.go_on(_BLOCK) for _ in range(run.done // _BLOCK)])
        if number == 0 and np.abs(beside - seen).max() <= _TOGETHER * amplitude:
            return False
        while abs(other.amplitude - amplitude) > _SAME * amplitude + 2.0 * off:
            if other.done > run.done + _LATER:
                return True
            other.go_on(_BLOCK)
    return False
