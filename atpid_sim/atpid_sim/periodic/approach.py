# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The transient of a scene, followed with tabulated contacts until it draws together regularly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.engine.settling_run import REGULAR, settle
from atpid_sim.outcome import Outcome
from atpid_sim.periodic.return_map import Conditions, ReturnMap
from atpid_sim.periodic.solve import least_size, size_of
from atpid_sim.scene import Scene
from atpid_sim.simulation.excitation import frequency_points
from atpid_sim.simulation.integration import Integration, drive_table
from atpid_sim.system import Array

#: Periods before contraction is looked for; in the last of them the section is chosen.
_SETTLED = 4


@dataclass(frozen=True)
class Approach:
    """A transient that contracts: its passages of a section, and how far it still has to go."""

    once: ReturnMap  # of the run that was followed, over one period
    periods: int
    passages: Array  # section states (k, n), `periods` apart
    scale: Array  # size of the motion (n,)
    time: float
    remaining: float  # distance still to go at the rate of contraction, relative
    growth: float  # of the distance between passages on the way, wherever they drew apart again


def still_from(scene: Scene) -> float:
    """Return the time from which on excitation and ceiling are what they are at the end [s]."""
    last = 0.0
    for points in (scene.excitation.amplitude_points, frequency_points(scene), scene.ceiling.heights):
        changes = [k for k in range(1, len(points)) if points[k][1] != points[k - 1][1]]
        last = max(last, float(points[changes[-1]][0]) if changes else 0.0)
    return last


def follow(scene: Scene, quick: Integration, conditions: Conditions, still: float) -> Approach | None:
    """Follow the scene until its passages of a section draw together regularly; None where they do not.

    still: when its last kink is [s].
    """
    period = 1.0 / conditions.frequency
    begin = period * (math.ceil(still / period) + _SETTLED - 1)
    most = int((scene.duration - begin) / period)
    if most < 1:
        return None
    rows = rows_until(scene, begin)
    state, sections = quick.initial_state().without_ledger(), np.empty((most, len(quick.sections.places)))
    table = _next_period(rows[-1], period)
    outcome, ending, passed, amplitude, count, periods, remaining = settle(
        quick.kernel_inputs, rows, table, state.y, state.n, quick.sections, quick.sizes(conditions.frequency),
        least_size(quick, conditions), quick.step_limit, sections,
    )  # fmt: skip
    if outcome != Outcome.DONE or ending != REGULAR:
        return None
    once = ReturnMap(quick, conditions, float(table[0, columns.PHASE]) / (2.0 * math.pi) % 1.0)
    passages, time = sections[:count][::-periods][::-1], begin + passed * period
    scale = size_of(quick, amplitude, conditions)
    return Approach(once, periods, passages, scale, time, remaining, _growth(passages / scale))


def _growth(passages: Array) -> float:
    """Return the product of all growths of the distance from passage to passage (k, n), in units of the motion.

    That distance is a disturbance, too: what it grew by on the way others have grown by.
    """
    moves = np.abs(passages[1:] - passages[:-1]).max(axis=1)
    ratios = moves[1:] / np.maximum(moves[:-1], 1e-300)
    return float(np.prod(np.maximum(ratios, 1.0)))


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


def _next_period(row: Array, period: float) -> Array:
    """Return the row (1, DRIVE_COLUMNS) of the period [s] after one of constant conditions, from time zero on."""
    following = row[None].copy()
    following[0, columns.PHASE] += row[columns.OMEGA] * (row[columns.END] - row[columns.START])
    following[0, columns.START], following[0, columns.END] = 0.0, period
    return following
