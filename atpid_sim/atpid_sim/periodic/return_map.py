# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The return map: the state of structure and grain one or more periods of the drive later, and its derivative.

A section state (n,) is displacement and velocity of each mode, then of the grain (`engine.sections`), at a phase of the
drive at which the grain flies freely; of one mode n is 4. There the map is smooth at every fidelity, with static
contact and integrated contacts on the way as well, and central differences of runs of the engine give its derivative.
"""

from __future__ import annotations

import math
from copy import copy
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.integration import NO_OBSERVATION, Integration, Observation, impact_log, sample_series
from atpid_sim.system import Array

#: Widths of differences, relative to the motion's size, the first that serves is taken: instantaneous impacts are exact
#: to rounding, integrated contacts repeat to about 1e-8. Near grazing only narrow ones lie on one side of it.
_EXACT_STEPS, _INTEGRATED_STEPS = (1e-5, 1e-7), (1e-3, 1e-4, 1e-5)
#: Change of the derivative with the width, relative to its largest entry in units of the motion, that serves.
_SMOOTH = 1e-3
#: Samples a period in which free flight is looked for, and impacts a period that are logged.
_SAMPLES, _LOG = 256, 200
#: Samples a period in which turns of the grain are looked for: their distance is right to 1e-8 of the motion's size.
_TURN_SAMPLES = 1024


class Conditions(NamedTuple):
    """What does not change while a motion repeats itself."""

    amplitude: float  # of the drive: of the support [m], or of a force [N]
    frequency: float  # of the drive [Hz]
    height: float  # of the ceiling above the floor [m]


class Orbit(NamedTuple):
    """What a motion does between two passages of the section."""

    amplitude: float  # half peak-to-peak of the beam [m]
    impacts: Array  # (k, 3): time after the section [s], wall (+1 floor, -1 ceiling), closing speed [m/s]


class Slope(NamedTuple):
    """Derivative of a return map."""

    matrix: Array  # (n, n), in the units of the section state
    coarse: Array  # (n, n), the same from differences twice as wide
    change: float  # largest difference of the two over the largest entry, in units of the motion: the error


class ReturnMap:
    """Section state (n,) to section state (n,), `periods` later; every call is a run of the engine."""

    def __init__(self, integration: Integration, conditions: Conditions, phase: float, periods: int = 1) -> None:
        """Prepare the runs.

        integration: system, contact, fidelity and tolerance; the amplitude, frequency and ceiling of its scene are not
        used. phase: of the section, as a share of a period, 0 where the drive passes zero upward.
        """
        self.integration, self.conditions = integration, conditions
        self.phase, self.periods = phase, periods
        self.duration = periods / conditions.frequency
        self._table = table_of(conditions, phase, self.duration)

    def by(self, integration: Integration) -> ReturnMap:
        """Return the same map by another integration: the conditions and the section stay."""
        other = copy(self)
        other.integration = integration
        return other

    def __call__(self, section: Array) -> Array:
        """Return the section state (n,) `periods` later.

        Raises NumericalFailure where the run does not end as it should, or the grain is in contact at the end.
        """
        after: Array = self.each(section[None])[0]
        return after

    def each(self, sections: Array) -> Array:
        """Return the section states (k, n) `periods` after each of these (k, n), in one call; raises as for one."""
        after, missing = self.integration.pass_sections(sections, self._table, len(sections))
        if missing:
            raise NumericalFailure(missing)
        return after

    def passages(self, section: Array, count: int) -> Array:
        """Return the next section states (k, n), `periods` apart: `count`, or those before a run that fails."""
        return self.integration.pass_sections(section[None], self._table, count)[0]

    def part(self, section: Array, share: float) -> Array:
        """Return the section state (n,) a share of the map's duration later, from one (n,). Raises NumericalFailure."""
        other = copy(self)
        other._table = table_of(self.conditions, self.phase, share * self.duration)
        return other(section)

    def orbit(self, section: Array) -> Orbit:
        """Return what happens until the next passage, from a section state (n,). Raises NumericalFailure."""
        return self._passage(section)[1]

    def passed(self, section: Array) -> tuple[Array, Orbit]:
        """Return the section state (n,) `periods` later, and what happens until then. Raises NumericalFailure."""
        state, orbit = self._passage(section)
        return _section_of(self.integration, state), orbit

    def _passage(self, section: Array) -> tuple[State, Orbit]:
        log = impact_log(_LOG * self.periods)
        state = self._advance(section, Observation((0.0, self.duration), impacts=log))
        return state, Orbit(state.amplitude, log[: state.n[columns.IMPACTS]])

    def clearance(self, section: Array) -> float:
        """Return the least distance [m] from a wall at which the grain of a periodic motion turns without touching it.

        section (n,): its section state. Infinite where it turns nowhere. Raises NumericalFailure.
        """
        count = _TURN_SAMPLES * self.periods
        series, log = sample_series(count), impact_log(_LOG * self.periods)
        spacing = self.duration / count
        state = self._advance(section, Observation(period=spacing, samples=series, impacts=log))
        gap = series[columns.S_GRAIN] - series[columns.S_BEAM]
        struck = (log[: state.n[columns.IMPACTS], columns.E_TIME] / spacing).astype(int)
        least = math.inf
        for distance in (gap, self.conditions.height - 2.0 * self.integration.system.radius - gap):
            free = distance > 0.0
            free[np.concatenate([struck % count, (struck + 1) % count])] = False
            before, after = np.roll(distance, 1), np.roll(distance, -1)
            turns = free & np.roll(free, 1) & np.roll(free, -1) & (distance <= before) & (distance < after)
            curvature = (after - 2.0 * distance + before)[turns]  # the vertex of a parabola through three samples
            lowest = distance[turns] - (after - before)[turns] ** 2 / (8.0 * curvature)
            least = min(least, float(lowest.min(initial=math.inf)))
        return least

    def slope(self, section: Array, scale: Array) -> Slope:
        """Return the derivative at a section state (n,) by central differences; scale (n,): size of the motion.

        Where differences twice as wide give another one, as near grazing, narrower ones are tried; of all the pair that
        agrees best is returned. Raises NumericalFailure.
        """
        first, *narrower = _EXACT_STEPS if self.integration.fidelity == "impact" else _INTEGRATED_STEPS
        slope = self._slope(section, scale, first)
        for width in narrower:
            if slope.change <= _SMOOTH:
                break
            slope = min(slope, self._slope(section, scale, width), key=lambda each: each.change)
        return slope

    def _slope(self, section: Array, scale: Array, width: float) -> Slope:
        fine, coarse = (self.differences(section, part * width * scale) for part in (0.5, 1.0))
        sizes = scale / scale[:, None]  # to units of the motion
        return Slope(fine, coarse, float(np.abs((fine - coarse) * sizes).max() / np.abs(fine * sizes).max()))

    def differences(self, section: Array, steps: Array) -> Array:
        """Return the derivative (n, n) at a section state by central differences of half-widths `steps` (n,), SI."""
        after = self.each(np.concatenate([section + np.diag(steps), section - np.diag(steps)]))
        slope: Array = (after[: len(steps)] - after[len(steps) :]).T / (2.0 * steps)
        return slope

    def forward_differences(self, section: Array, steps: Array) -> tuple[Array, Array]:
        """Return the section state (n,) `periods` later, and the derivative by forward differences: half the runs."""
        after = self.each(np.concatenate([section[None], section + np.diag(steps)]))
        return after[0], (after[1:] - after[0]).T / steps

    def _advance(self, section: Array, observation: Observation) -> State:
        state = self.integration.sections.flying(section)
        self.integration.advance_whole(state, self._table, observation)
        return state


def _section_of(integration: Integration, state: State) -> Array:
    """Return the section state (n,) of a state of the engine; raise NumericalFailure where the grain is in contact."""
    if state.mode != columns.FREE:
        raise NumericalFailure("the grain is in contact at the phase of the section")
    return state.y[integration.sections.places]


def passage(
    integration: Integration, conditions: Conditions, state: State, phase: float = 0.0, periods: int = 1
) -> tuple[float, Array]:
    """Return the best section, and where a motion passes it: phase, and section state (n,).

    state: of the motion at `phase`, any time, contact or flight. The section is the middle of the longest free flight
    of the next `periods`, where impacts can move most before they reach it. Raises NumericalFailure where there is
    no free flight, or the run does not end as it should.
    """
    period = 1.0 / conditions.frequency
    count = _SAMPLES * periods
    series, log = sample_series(count), impact_log(_LOG * periods)
    spacing = period / _SAMPLES
    seen = Observation(period=spacing, samples=series, impacts=log)
    logged = _run(integration, conditions, state, phase, periods * period, seen).n[columns.IMPACTS]
    gap = series[columns.S_GRAIN] - series[columns.S_BEAM]
    clearance = conditions.height - 2.0 * integration.system.radius - gap
    free = (gap > 0.0) & (clearance > 0.0)
    free[(log[:logged, columns.E_TIME] / spacing).astype(int) % count] = False  # a contact may lie between samples
    middle = _middle_of_longest(free)
    if middle is None:
        raise NumericalFailure("the grain is always in contact: there is no free flight to take a section in")
    later = _run(integration, conditions, state, phase, middle * spacing) if middle else state
    return (phase + middle / _SAMPLES) % 1.0, _section_of(integration, later)


def _middle_of_longest(free: Array) -> int | None:
    """Return the place in the middle of the longest run of true values (n,), taken as a ring; None without any."""
    if free.all():
        return 0
    first = int(np.argmin(free))  # begin behind a contact, so that no run is cut
    ring = np.concatenate([free[first + 1 :], free[:first]])
    edges = np.flatnonzero(np.diff(ring, prepend=False, append=False))
    begins, ends = edges[::2], edges[1::2]
    if not len(ends):
        return None
    longest = int(np.argmax(ends - begins))
    return int(first + ends[longest] - (ends[longest] - begins[longest]) // 2) % len(free)


def _run(
    integration: Integration,
    conditions: Conditions,
    state: State,
    phase: float,
    duration: float,
    observation: Observation = NO_OBSERVATION,
) -> State:
    """Return the state a duration [s] after `state`, which is left as it is. Raises NumericalFailure."""
    later = state.copy()
    later.y[columns.TIME] = 0.0
    later.restart_observation()
    integration.advance_whole(later, table_of(conditions, phase, duration), observation)
    return later


def table_of(conditions: Conditions, phase: float, duration: float) -> Array:
    """Return the drive table (1, DRIVE_COLUMNS) of constant conditions, from a phase in periods, for so long [s]."""
    row = np.zeros((1, columns.DRIVE_COLUMNS))  # a few periods: `drive.harmonic_rows` takes as long as they do
    row[0, columns.END] = duration
    row[0, columns.A0], row[0, columns.OMEGA] = conditions.amplitude, 2.0 * math.pi * conditions.frequency
    row[0, columns.PHASE], row[0, columns.HEIGHT] = 2.0 * math.pi * phase, conditions.height
    return row
