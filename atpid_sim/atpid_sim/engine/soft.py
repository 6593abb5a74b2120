# SPDX-License-Identifier: Apache-2.0
"""The `soft` rung: exact flight between contacts, contacts integrated; row by row through the drive table."""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import energy, restitution
from atpid_sim.engine.drive import A0, A1, C0, C2, END, HEIGHT, HEIGHT_RATE, OMEGA, START
from atpid_sim.engine.flight import fly
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.observe import note_extreme
from atpid_sim.engine.release import resting_overlap
from atpid_sim.engine.settle import hops_idly, settle
from atpid_sim.engine.state import (
    BEAM,
    BEAM_RATE,
    BEGUN,
    CEILING_HITS,
    CONTACT_LOSS,
    E_SPEED,
    E_TIME,
    E_WALL,
    EVENTS,
    FLOOR_HITS,
    GRAIN,
    GRAIN_RATE,
    MEMORY,
    MODE,
    ON_CEILING,
    ON_FLOOR,
    TIME,
    WINDOW_CEILING,
    WINDOW_FLOOR,
    spent,
)
from atpid_sim.engine.touch import DEPTH_FLOOR, touch

#: Share of the tolerance with which the contacts of an elastic grain are integrated, and the finest there is.
_ELASTIC = 0.01
_FINEST = 1e-12

DONE, STEP_BUDGET, NOT_FINITE, ESCAPED, OVERLAP_TOO_DEEP, CEILING_CRUSHES, STALLED = range(7)  # as in `outcome.py`


@kernel
def log_impact(y, n, events, now, observing, height_rate):  # type: ignore[no-untyped-def]
    """Count a new contact and remember when and how fast it began."""
    on_floor = n[MODE] == ON_FLOOR
    speed = y[BEAM_RATE] - y[GRAIN_RATE] if on_floor else y[GRAIN_RATE] - y[BEAM_RATE] - height_rate
    n[FLOOR_HITS if on_floor else CEILING_HITS] += 1
    if observing:
        n[WINDOW_FLOOR if on_floor else WINDOW_CEILING] += 1
    if n[EVENTS] < events.shape[0]:
        events[n[EVENTS], E_TIME] = now
        events[n[EVENTS], E_WALL] = 1.0 if on_floor else -1.0
        events[n[EVENTS], E_SPEED] = speed
        n[EVENTS] += 1
    y[MEMORY] = 0.0
    y[BEGUN] = now


@kernel
def _fault(y, height, slack, radius):  # type: ignore[no-untyped-def]
    """Outcome that the present state amounts to, DONE where it is sound."""
    lift = y[GRAIN] - y[BEAM]
    if not (math.isfinite(y[BEAM]) and math.isfinite(y[BEAM_RATE]) and math.isfinite(y[GRAIN_RATE]) and math.isfinite(lift)):  # fmt: skip # noqa: E501
        return NOT_FINITE
    if height < slack * (1.0 - 1e-12):
        return CEILING_CRUSHES
    overlap = max(-lift, lift - (height - slack))
    if overlap > radius:
        return OVERLAP_TOO_DEEP
    return DONE


@kernel
def sound_length(segment, slack):  # type: ignore[no-untyped-def]
    """How long the ceiling stays at or above the grain's diameter in this row [s]; the row's length if all the time."""
    length = segment[END] - segment[START]
    if min(segment[HEIGHT], segment[HEIGHT] + segment[HEIGHT_RATE] * length) >= slack * (1.0 - 1e-12):
        return length
    return 0.0 if segment[HEIGHT] <= slack else (slack - segment[HEIGHT]) / segment[HEIGHT_RATE]


@kernel
def _error_scale(table, system, law, p, y):  # type: ignore[no-untyped-def]
    """Overlap [m], overlap rate [m/s] and swing [m] below which the errors of a contact count as absolute.

    The overlap is a tenth of what a twentieth of the run's typical acceleration, weight included, presses the grain in;
    the swing a thousandth of the run's typical displacement.
    """
    natural = system.stiffness / system.beam_mass
    rest = -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    motion = natural * abs(y[BEAM] - rest) + math.sqrt(natural) * abs(y[BEAM_RATE])
    for row in range(table.shape[0]):
        a0, a1, omega = abs(table[row, A0]), abs(table[row, A1]), table[row, OMEGA]
        swing = max(a0, a0 + a1 * (table[row, END] - table[row, START]))
        motion = max(
            motion, min(omega * omega, natural) * swing, 2.0 * abs(table[row, C2]), natural * abs(table[row, C0])
        )
    pace = max(0.05 * (motion + system.gravity), 1e-12)
    overlap = 0.1 * resting_overlap(law, p, system.grain_mass * pace, 0.1)
    return overlap, math.sqrt(pace * overlap), 1e-3 * motion / natural + overlap


@kernel
def _contact_tolerance(system, law, p, rtol, scale):  # type: ignore[no-untyped-def]
    """Tolerance for contacts: what an elastic grain gains or loses in one it keeps for 1 / (1 - e) further ones.

    Restitution is taken where it is largest, at the slow or at the fast end of the run's impacts.
    """
    reduced = system.beam_mass * system.grain_mass / (system.beam_mass + system.grain_mass)
    slow, fast = scale[1], scale[1] * math.sqrt(system.radius / scale[0])
    e = max(restitution(law, slow, reduced, p), restitution(law, fast, reduced, p))
    return max(rtol * min(1.0, max(_ELASTIC, 2.0 * (1.0 - e))), min(rtol, _FINEST))


@kernel
def run(table, system, law, hysteretic, p, rtol, y, n, observe, sampling, out, events, budget):  # type: ignore[no-untyped-def]
    """Integrate through the drive table (rows, 12) from y[TIME] to its end; returns an `Outcome` as an integer.

    `observe`: (from, to) [s], both row edges of the table where extremes shall be exact; `sampling`: (first instant,
    period) [s]; `out`: series (6, samples); `events`: impact log (capacity, 3). y and n are the state, changed in
    place (see `state.py`), also when the run ends early.
    """
    slack = 2.0 * system.radius
    stuck = 0
    scale = _error_scale(table, system, law, p, y)
    strict = _contact_tolerance(system, law, p, rtol, scale)
    for row in range(table.shape[0]):
        segment = table[row]
        start, end = segment[START], segment[END]
        if end <= y[TIME]:
            continue
        length = sound_length(segment, slack)
        middle = 0.5 * (start + end)
        observing = observe[0] <= middle <= observe[1]
        if observing:
            note_extreme(y, y[BEAM])
        tau, until = y[TIME] - start, length
        where = (sampling[0], sampling[1], start)
        while tau < until:
            before = tau
            if n[MODE] == ON_FLOOR or n[MODE] == ON_CEILING:
                tau = touch(
                    y, n, segment, tau, until, system, law, hysteretic, p, strict, scale, observing, where, out, budget
                )
            else:
                tau = fly(y, n, segment, tau, until, system, law, p, observing, where, out, budget)
                if y[MEMORY] < 0.0:
                    log_impact(y, n, events, start + tau, observing, segment[HEIGHT_RATE])
                    if hops_idly(y, n, segment, tau, system, DEPTH_FLOOR * rtol):
                        settle(y, n, segment, tau, system, law, p)
                elif n[MODE] == ON_FLOOR or n[MODE] == ON_CEILING:
                    # a force again before the surfaces parted: what was given up at the release is held again
                    lift = y[GRAIN] - y[BEAM]
                    room = segment[HEIGHT] + segment[HEIGHT_RATE] * tau - slack
                    overlap = -lift if n[MODE] == ON_FLOOR else lift - room
                    y[CONTACT_LOSS] -= energy(law, max(overlap, 0.0), y[MEMORY], p)
            y[TIME] = start + tau
            if spent(n) >= budget:
                return STEP_BUDGET
            fault = _fault(y, segment[HEIGHT] + segment[HEIGHT_RATE] * tau, slack, system.radius)
            if fault != DONE:
                return fault
            stuck = stuck + 1 if tau == before else 0
            if stuck > 1000:
                return STALLED
        if length < end - start:
            return CEILING_CRUSHES
        y[TIME] = end
    return DONE
