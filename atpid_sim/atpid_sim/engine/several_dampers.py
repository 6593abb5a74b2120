# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Several dampers on one structure, a grain in each: flights, impacts, and grains at rest as part of the structure.

Between events all move as power series (`power_series`): the structure with the masses of the grains that rest on it,
the others in free flight. An event is the first touch of a wall, or the first moment at which a wall would have to hold
a grain that rests on it. Impacts are instantaneous (`meeting`).
"""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.impact_phase import COLLAPSE
from atpid_sim.engine.meeting import clamps, clearance_of, meet, side_of
from atpid_sim.engine.power_series import (
    ORDER,
    drive_series,
    enter_force,
    first_zero,
    inverse_mass,
    structure_series,
    value_and_rates,
)  # fmt: skip
from atpid_sim.engine.row_loop import STALLED, open_length
from atpid_sim.engine.sampling import SampleView, next_sample, record_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.engine.work import NODES, WEIGHTS
from atpid_sim.kernel import kernel
from atpid_sim.outcome import Outcome
from atpid_sim.system import Array

#: A gap below this fraction of the lengths in play is a touch, a velocity or acceleration below such one is rounding.
_TOUCH, _STILL, _WEIGHTLESS = 1e-14, 1e-15, 1e-12
#: Share of the accelerations below which the pressing force on a grain vanishes together with that on another.
_TOGETHER = 1e-9


class Scratch(NamedTuple):
    """What a step computes with."""

    drive: Array  # series of the signal (ORDER + 1,)
    q: Array  # of the modes (modes, ORDER + 1)
    path: Array  # of the container of each damper (dampers, ORDER + 1)
    gap: Array  # of what is looked at (ORDER + 1,)
    inverse: Array  # of the mass matrix (modes, modes)
    force: Array  # (modes,)
    weight: Array  # (modes,)
    wall: Array  # displacement, velocity and acceleration of the containers after the step (dampers, 3)


@kernel
def _parts(d, y, n):
    """States of the modes, grains and counters of the dampers, as views."""
    end = at.STATE_SIZE + d.modes.shape[1] * at.MODE_COLUMNS
    states = y[at.STATE_SIZE : end].reshape(-1, at.MODE_COLUMNS)
    return states, y[end:].reshape(-1, at.GRAIN_COLUMNS), n[at.COUNTERS :].reshape(-1, at.DAMPER_COUNTERS)


@kernel
def _let_off(d, work, segment, tau, hits, held, clamped, keep):
    """Free the grains that their walls would have to hold; returns whether one is pressed deeper than its radius.

    keep: whether all of them are held on, whatever their walls do. Leaves what `structure_series` takes.
    """
    for j in range(hits.shape[0]):
        held[j] = hits[j, at.D_MODE] != at.FREE
        clamped[j] = held[j] and clamps(d, segment, tau, j)
    while True:
        inverse_mass(d.modes, d.table, d.shapes, held, work.inverse)
        work.weight[:] = d.modes[at.MASS] * d.modes[at.WEIGHT]
        for j in range(hits.shape[0]):
            if held[j]:
                work.weight[:] += d.table[j, at.GRAIN_MASS] * d.gravity * d.shapes[j]
        enter_force(d.modes, work.drive, work.q, 0, work.force)
        acceleration = work.inverse @ (work.force - work.weight)
        least, first = -_WEIGHTLESS, -1
        for j in range(hits.shape[0]):
            if held[j]:
                a = d.shapes[j] @ acceleration
                if d.table[j, at.GRAIN_MASS] * abs(a + d.gravity) > d.table[j, at.CRUSHING]:
                    return True
                share = side_of(hits[j, at.D_MODE]) * (a + d.gravity) / max(abs(a) + d.gravity, 1e-300)
                if not clamped[j] and share < least:
                    least, first = share, j
        if first < 0 or keep:
            return False
        held[first], hits[first, at.D_MODE] = False, at.FREE


@kernel
def _first_event(d, work, segment, tau, longest, grains, hits, held, clamped):
    """How long nothing happens, at most `longest` [s]; to which damper something happens then, -1: none; if a touch."""
    step, which, touches = longest, -1, False
    series = work.gap
    for j in range(hits.shape[0]):
        path = work.path[j]
        path[:] = 0.0
        for i in range(d.shapes.shape[1]):
            for n in range(ORDER + 1):
                path[n] += d.shapes[j, i] * work.q[i, n]
        if clamped[j]:
            continue
        if held[j]:  # the pressing force over the grain's mass
            side = side_of(hits[j, at.D_MODE])
            series[:] = 0.0
            for n in range(ORDER - 1):
                series[n] = side * (n + 1.0) * (n + 2.0) * path[n + 2]
            series[0] += side * d.gravity
            noise = 0.1 * _WEIGHTLESS * (2.0 * abs(path[2]) + d.gravity)
            step, found = first_zero(series, step, noise)
            if found:
                which, touches = j, False
            continue
        place, speed = grains[j, at.G_PLACE], grains[j, at.G_SPEED]
        clearance, opening = clearance_of(d, segment, tau, j)
        series[:] = -path
        series[0] += place
        series[1] += speed
        series[2] -= 0.5 * d.gravity
        touch = _TOUCH * (abs(path[0]) + abs(place) + 2.0 * d.table[j, at.RADIUS])
        if abs(series[2]) <= _WEIGHTLESS * (2.0 * abs(path[2]) + d.gravity):
            series[2] = 0.0
        for side in (1.0, -1.0):  # floor, ceiling
            if side < 0.0:
                series[:] = -series
                series[0] += clearance
                series[1] += opening
            if abs(series[1]) <= _STILL * (abs(path[1]) + abs(speed) + abs(opening)):
                series[1] = 0.0
            step, found = first_zero(series, step, touch)
            if found:
                which, touches = j, True
    return step, which, touches


@kernel
def _add_work(d, work, step, y):
    """Add the work of the drive and the loss of the structure's dampers in a step."""
    for node, weighting in zip(NODES, WEIGHTS):  # noqa: B905  numba's zip takes no keyword
        u, w, _ = value_and_rates(work.drive, step * node)
        for i in range(work.q.shape[0]):
            v = value_and_rates(work.q[i], step * node)[1]
            driven = d.modes[at.DIRECT, i] * u + d.modes[at.RATE, i] * w
            y[at.INPUT] += step * weighting * driven * v
            y[at.BEAM_LOSS] += step * weighting * d.modes[at.DAMPING, i] * v * v


@kernel
def _observe(work, step, y):
    """Record the first container's displacement after a step, and where it has turned in it."""
    path = work.path[0]
    x, v, _a = value_and_rates(path, step)
    record_extreme(y, x)
    if path[1] * v < 0.0:
        s = step * path[1] / (path[1] - v)
        for _ in range(5):
            _x, rate, a = value_and_rates(path, s)
            if a == 0.0:
                break
            s = min(max(s - rate / a, 0.0), step)
        record_extreme(y, value_and_rates(path, s)[0])


@kernel
def _sample(d, work, segment, tau, ahead, grains, hits, held, n, view, out):
    """Write the samples up to local time `ahead` of a step that begins at tau; grains: at its begin."""
    due = next_sample(n, out, view)
    while due <= ahead:
        k, s = n[at.SAMPLE], due - tau
        ceiling = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * due
        out[at.S_SUPPORT, k], out[at.S_CEILING, k] = value_and_rates(work.drive, s)[0], ceiling
        out[at.S_BEAM, k], out[at.S_VELOCITY, k], out[at.S_ACCELERATION, k] = value_and_rates(work.path[0], s)
        for j in range(hits.shape[0]):
            row = at.S_GRAIN if j == 0 else at.SAMPLE_ROWS + j - 1
            if row >= out.shape[0]:
                break
            if held[j]:
                lifted = clearance_of(d, segment, due, j)[0] if hits[j, at.D_MODE] == at.ON_CEILING else 0.0
                out[row, k] = value_and_rates(work.path[j], s)[0] + lifted
            else:
                out[row, k] = grains[j, at.G_PLACE] + s * (grains[j, at.G_SPEED] - 0.5 * d.gravity * s)
        n[at.SAMPLE] = k + 1
        due = next_sample(n, out, view)


@kernel
def _move(d, work, segment, step, ahead, y, states, grains, hits, held, observing):
    """Enter where a step of `step` [s], which ends at local time `ahead`, has led structure and grains."""
    for i in range(states.shape[0]):
        states[i, at.Q], states[i, at.Q_RATE], _a = value_and_rates(work.q[i], step)
    for j in range(hits.shape[0]):
        work.wall[j] = value_and_rates(work.path[j], step)
        before = grains[j, at.G_SPEED]
        if held[j]:
            clearance, opening = clearance_of(d, segment, ahead, j)
            lifted, moving = (clearance, opening) if hits[j, at.D_MODE] == at.ON_CEILING else (0.0, 0.0)
            grains[j, at.G_PLACE], grains[j, at.G_SPEED] = work.wall[j, 0] + lifted, work.wall[j, 1] + moving
            gained = grains[j, at.G_SPEED] - before + d.gravity * step
            y[at.CEILING_WORK] += moving * d.table[j, at.GRAIN_MASS] * gained
            grains[j, at.G_TOUCHING] += step if observing else 0.0
        else:
            grains[j, at.G_PLACE] += step * (before - 0.5 * d.gravity * step)
            grains[j, at.G_SPEED] -= d.gravity * step
    y[at.BEAM], y[at.BEAM_VELOCITY] = work.wall[0, 0], work.wall[0, 1]


@kernel
def _sound(d, segment, tau, y, grains, work):
    """Outcome that the present state amounts to, DONE where it is sound."""
    for j in range(grains.shape[0]):
        gap, clearance = grains[j, at.G_PLACE] - work.wall[j, 0], clearance_of(d, segment, tau, j)[0]
        if not (math.isfinite(gap) and math.isfinite(grains[j, at.G_SPEED]) and math.isfinite(y[at.BEAM_VELOCITY])):
            return Outcome.NOT_FINITE
        if max(-gap, gap - clearance) > d.table[j, at.RADIUS]:
            return Outcome.ESCAPED
    return Outcome.DONE


@kernel
def _pass_row(d, work, segment, y, n, view, out, impacts, budget):
    """Advance through a row of the drive table; returns the outcome."""
    states, grains, hits = _parts(d, y, n)
    held, clamped = np.zeros(len(hits), np.bool_), np.zeros(len(hits), np.bool_)
    tone = segment[at.OMEGA] if segment[at.A0] != 0.0 or segment[at.A1] != 0.0 else 0.0
    stride, fastest = 1.0 / max(d.rate, tone), max(d.pace, tone)
    length = open_length(segment, 2.0 * d.table[0, at.RADIUS])
    moving = segment[at.CEILING_VELOCITY]
    if hits[0, at.D_MODE] == at.ON_CEILING and grains[0, at.G_SPEED] - y[at.BEAM_VELOCITY] != moving:
        hits[0, at.D_MODE] = at.FREE  # a ceiling that has changed its velocity departs from the grain or hits it
    if view.observing:
        record_extreme(y, y[at.BEAM])
    tau, stuck = y[at.TIME] - segment[at.START], 0
    while tau < length:
        n[at.FLIGHT_STEPS] += 1
        work.q[:, 0], work.q[:, 1] = states[:, at.Q], states[:, at.Q_RATE]
        drive_series(segment, tau, work.drive)
        if _let_off(d, work, segment, tau, hits, held, clamped, stuck > COLLAPSE):
            return Outcome.OVERLAP_TOO_DEEP
        structure_series(d.modes, work.inverse, work.weight, work.drive, work.q)
        longest = min(stride, length - tau)
        step, which, touches = _first_event(d, work, segment, tau, longest, grains, hits, held, clamped)
        if stuck > COLLAPSE:  # as where a contact is nothing but rounding
            step = max(step, min(longest, 1e-9 * stride))
        ahead = length if step >= length - tau else tau + step
        _add_work(d, work, step, y)
        if view.observing:
            _observe(work, step, y)
        _sample(d, work, segment, tau, ahead, grains, hits, held, n, view, out)
        _move(d, work, segment, step, ahead, y, states, grains, hits, held, view.observing)
        stuck = stuck + 1 if ahead == tau else 0
        tau = ahead
        y[at.TIME] = segment[at.START] + tau
        outcome = _sound(d, segment, tau, y, grains, work)
        if which >= 0 and touches and outcome == Outcome.DONE:
            crushed = meet(
                d, work.wall, segment, tau, which, y, n, states, grains, hits, clamped, fastest, stuck, view, impacts
            )  # fmt: skip
            outcome = Outcome.OVERLAP_TOO_DEEP if crushed else Outcome.DONE
        elif which >= 0 and not touches:
            hits[which, at.D_MODE] = at.FREE
            for j in range(len(hits)):  # those at one place are let off together
                a = work.wall[j, 2]
                pressing = side_of(hits[j, at.D_MODE]) * (a + d.gravity)
                if held[j] and not clamped[j] and pressing <= _TOGETHER * (abs(a) + d.gravity):
                    hits[j, at.D_MODE] = at.FREE
        if outcome != Outcome.DONE:
            return outcome
        if steps_used(n) >= budget:
            return Outcome.STEP_BUDGET
        if stuck > STALLED:
            return Outcome.STALLED
    return Outcome.CEILING_CRUSHES if length < segment[at.END] - segment[at.START] else Outcome.DONE


@kernel
def integrate_dampers(table, d, y, n, window, sampling, out, impacts, budget):
    """Integrate several dampers through the drive table; returns an outcome's value.

    d: `Dampers`. y, n: the state (`columns`), changed in place. out has a row for each further grain behind the others,
    impacts a column more, the damper's number. The rest as in `row_loop.integrate`.
    """
    count, dampers, powers = d.modes.shape[1], d.table.shape[0], ORDER + 1
    work = Scratch(
        np.empty(powers), np.empty((count, powers)), np.empty((dampers, powers)), np.empty(powers),
        np.empty((count, count)), np.empty(count), np.empty(count), np.empty((dampers, 3)),
    )  # fmt: skip
    outcome = Outcome.DONE
    for row in range(table.shape[0]):
        segment = table[row]
        start, end = segment[at.START], segment[at.END]
        if end <= y[at.TIME]:
            continue
        view = SampleView(window[0] <= 0.5 * (start + end) <= window[1], sampling[0], sampling[1], start)
        outcome = _pass_row(d, work, segment, y, n, view, out, impacts, budget)
        if outcome != Outcome.DONE:
            break
        y[at.TIME] = end
    _states, grains, hits = _parts(d, y, n)
    y[at.GRAIN], y[at.GRAIN_VELOCITY], n[at.MODE] = grains[0, at.G_PLACE], grains[0, at.G_SPEED], hits[0, at.D_MODE]
    y[at.CONTACT_TIME] = grains[0, at.G_TOUCHING]
    return outcome.value
