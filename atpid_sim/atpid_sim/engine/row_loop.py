# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The integration of a run, row by row through the drive table, at every fidelity."""

import math
from enum import IntEnum

import numpy as np

from atpid_sim.contact.dispatch import energy
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import columns as at
from atpid_sim.engine.contact_phase import contact
from atpid_sim.engine.error_control import DEPTH_FLOOR, ErrorControl, control_of
from atpid_sim.engine.finite_contact import hold, tabulated_contact
from atpid_sim.engine.flight import flight
from atpid_sim.engine.impact_phase import begin_impact_row, collide, is_held, press_held, stick
from atpid_sim.engine.micro_bounce import closing_speed, only_micro_bounces, replace_by_static_contact
from atpid_sim.engine.modal_room import keep, unowned, with_room
from atpid_sim.engine.modes import container_mass
from atpid_sim.engine.one_mass_phase import one_mass
from atpid_sim.engine.sampling import SampleView, record_extreme
from atpid_sim.engine.sections import enter_section, leave_section
from atpid_sim.engine.state import steps_used
from atpid_sim.kernel import kernel
from atpid_sim.outcome import Outcome

#: What `pass_sections` returns where the grain is in contact at the end.
IN_CONTACT = -1
#: Phases without any progress in time after which a run ends as STALLED.
STALLED = 1000


class Fidelity(IntEnum):
    """What a run integrates; the values are those that kernels compare."""

    SIMPLIFIED = 0  # one mass in closed form: beam and grain, or the beam alone
    IMPACT = 1  # contacts instantaneous
    SOFT = 2  # contacts integrated
    FINITE = 3  # contacts of finite duration from a table, others integrated


@kernel
def _begin_contact(y, n, impacts, now, observing, ceiling_velocity):
    """Count a new contact and log its time, wall and closing speed."""
    on_floor = n[at.MODE] == at.ON_FLOOR
    side = 1.0 if on_floor else -1.0
    n[at.FLOOR_HITS if on_floor else at.CEILING_HITS] += 1
    if observing:
        n[at.WINDOW_FLOOR if on_floor else at.WINDOW_CEILING] += 1
    if n[at.IMPACTS] < impacts.shape[0]:
        impacts[n[at.IMPACTS], at.E_TIME] = now
        impacts[n[at.IMPACTS], at.E_WALL] = side
        impacts[n[at.IMPACTS], at.E_SPEED] = closing_speed(y, side, ceiling_velocity)
        n[at.IMPACTS] += 1
    y[at.DEEPEST] = 0.0
    y[at.BEGUN] = now


@kernel
def _resume_contact(y, n, segment, tau, diameter, law, p):
    """A force before the surfaces have parted: the energy entered as lost at detachment is stored again."""
    gap = y[at.GRAIN] - y[at.BEAM]
    clearance = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau - diameter
    overlap = -gap if n[at.MODE] == at.ON_FLOOR else gap - clearance
    y[at.CONTACT_LOSS] -= energy(law, max(overlap, 0.0), y[at.DEEPEST], p)


@kernel
def _soft_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts):
    """One contact or flight of the fidelity `soft`; returns the local time reached."""
    if n[at.MODE] == at.ON_FLOOR or n[at.MODE] == at.ON_CEILING:
        return contact(y, n, segment, tau, until, system, law, p, control, view, out)
    tau = flight(y, n, segment, tau, until, system, law, p, control, view, out)
    if y[at.DEEPEST] < 0.0:
        _begin_contact(y, n, impacts, view.origin + tau, view.observing, segment[at.CEILING_VELOCITY])
        if only_micro_bounces(y, n, segment, tau, system, DEPTH_FLOOR * control.rtol):
            replace_by_static_contact(y, n, segment, tau, system, law, p)
    elif n[at.MODE] == at.ON_FLOOR or n[at.MODE] == at.ON_CEILING:
        _resume_contact(y, n, segment, tau, 2.0 * system.radius, law, p)
    return tau


@kernel
def _deepest(y, n, segment, tau, until, system, law, p, control):
    """Deepest overlap [m] of the contact that begins at local time tau, integrated aside."""
    aside, counts = y.copy(), n.copy()
    fine = control_of(segment.reshape(1, segment.size), system, law, p, control.rtol, control.budget, y)
    view, unsampled = SampleView(False, math.inf, 1.0, 0.0), np.zeros((at.SAMPLE_ROWS, 0))
    contact(aside, counts, segment, tau, until, system, law, p, fine, view, unsampled)
    return aside[at.DEEPEST]


@kernel
def _impact_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts, stuck, fast):
    """One flight with the impact at its end, or sticking, of the fidelity `impact`; returns the local time reached.

    fast: closing speed from which on a contact may be deeper than the grain's radius [m/s].
    """
    if n[at.MODE] == at.ON_FLOOR or n[at.MODE] == at.ON_CEILING:
        tau = stick(y, n, segment, tau, until, system, control, view, out)
        if fast < math.inf and is_held(segment, tau, system):
            press_held(y, segment, tau, system, law, p)
        return tau
    tau = flight(y, n, segment, tau, until, system, law, p, control, view, out)
    if n[at.MODE] != at.FREE:
        _begin_contact(y, n, impacts, view.origin + tau, view.observing, segment[at.CEILING_VELOCITY])
        if closing_speed(y, 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0, segment[at.CEILING_VELOCITY]) > fast:
            y[at.DEEPEST] = _deepest(y, n, segment, tau, until, system, law, p, control)
        bounces = collide(y, n, segment, tau, system, law, p, stuck)
        if view.observing:
            y[at.CONTACT_TIME] -= bounces  # `stick` counts from now on, and they are flights
    return tau


@kernel
def _finite_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts, table):
    """One contact, or flight with the contact at its end, of the fidelity `finite`; returns the local time reached."""
    if n[at.MODE] == at.ON_FLOOR or n[at.MODE] == at.ON_CEILING:
        if is_held(segment, tau, system):
            return hold(y, n, segment, tau, until, system, law, p, control, view, out)
        return contact(y, n, segment, tau, until, system, law, p, control, view, out)
    tau = flight(y, n, segment, tau, until, system, law, p, control, view, out)
    if y[at.DEEPEST] < 0.0:
        _begin_contact(y, n, impacts, view.origin + tau, view.observing, segment[at.CEILING_VELOCITY])
        if only_micro_bounces(y, n, segment, tau, system, DEPTH_FLOOR * control.rtol):
            replace_by_static_contact(y, n, segment, tau, system, law, p)
        elif not is_held(segment, tau, system):
            return tabulated_contact(y, n, segment, tau, until, system, law, p, control, view, out, table)
    elif n[at.MODE] == at.ON_FLOOR or n[at.MODE] == at.ON_CEILING:
        _resume_contact(y, n, segment, tau, 2.0 * system.radius, law, p)
    return tau


@kernel
def _fault(fidelity, y, height, diameter):
    """Outcome that the present state amounts to, DONE where it is sound."""
    gap = y[at.GRAIN] - y[at.BEAM]
    if not (
        math.isfinite(y[at.BEAM])
        and math.isfinite(y[at.BEAM_VELOCITY])
        and math.isfinite(y[at.GRAIN_VELOCITY])
        and math.isfinite(gap)
    ):
        return Outcome.NOT_FINITE
    if fidelity == Fidelity.SIMPLIFIED:
        return Outcome.DONE
    if height < diameter * (1.0 - 1e-12):
        return Outcome.CEILING_CRUSHES
    if y[at.DEEPEST] > 0.5 * diameter:
        return Outcome.OVERLAP_TOO_DEEP
    if max(-gap, gap - (height - diameter)) > 0.5 * diameter:
        return Outcome.ESCAPED if fidelity == Fidelity.IMPACT else Outcome.OVERLAP_TOO_DEEP
    return Outcome.DONE


@kernel
def open_length(segment, diameter):
    """How long the ceiling stays at or above the grain's diameter in this row [s]; the row's length if all the time."""
    length = segment[at.END] - segment[at.START]
    if min(segment[at.HEIGHT], segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * length) >= diameter * (1.0 - 1e-12):
        return length
    return 0.0 if segment[at.HEIGHT] <= diameter else (diameter - segment[at.HEIGHT]) / segment[at.CEILING_VELOCITY]


@kernel
def _fast(system, law, p):
    """Closing speed from which on a contact may be deeper than the grain's radius: undamped, and with some to spare."""
    if law == IMPACT:
        return math.inf
    beam_mass = container_mass(system.modes, system)
    reduced = beam_mass * system.grain_mass / (beam_mass + system.grain_mass)
    return 0.8 * math.sqrt(2.0 * energy(law, system.radius, system.radius, p) / reduced)


@kernel
def _control(run, table, budget, y):
    """Budget and error control of a run from state y through the drive table."""
    fidelity, system, _mass, law, p, rtol, _contacts = run
    if fidelity == Fidelity.SOFT or fidelity == Fidelity.FINITE:
        return control_of(table, system, law, p, rtol, budget, y)
    return ErrorControl(budget, rtol, rtol, 0.0, 0.0, 0.0)


@kernel
def _integrate(run, mass, table, control, y, n, window, sampling, out, impacts):
    """`integrate`, with an `Outcome`."""
    fidelity, system, _mass, law, p, _rtol, contacts = run
    own, owner = with_room(system.modes, system)
    ended = _advance(
        fidelity, unowned(table), own, mass, law, unowned(p), control, unowned(y), unowned(n), window, sampling,
        unowned(out), unowned(impacts), contacts,
    )  # fmt: skip
    keep(owner)
    return ended


@kernel
def _advance(fidelity, table, system, mass, law, p, control, y, n, window, sampling, out, impacts, contacts):
    """The same, of a system with room for what is computed of its modes."""
    with_grain = mass != system.beam_mass
    diameter = 2.0 * system.radius
    stuck, fast = np.int64(0), _fast(system, law, p)  # with a literal 0 what takes it would be compiled twice
    if fidelity == Fidelity.SIMPLIFIED and not with_grain:
        n[at.MODE] = at.FREE
    for row in range(table.shape[0]):
        segment = table[row]
        start, end = segment[at.START], segment[at.END]
        if end <= y[at.TIME]:
            continue
        length = end - start if fidelity == Fidelity.SIMPLIFIED else open_length(segment, diameter)
        view = SampleView(window[0] <= 0.5 * (start + end) <= window[1], sampling[0], sampling[1], start)
        if view.observing:
            record_extreme(y, y[at.BEAM])
        if fidelity == Fidelity.IMPACT:
            begin_impact_row(y, n, segment)
        tau, until = y[at.TIME] - start, length
        while tau < until:
            before = tau
            if fidelity == Fidelity.SOFT:
                tau = _soft_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts)
            elif fidelity == Fidelity.FINITE:
                tau = _finite_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts, contacts)
            elif fidelity == Fidelity.IMPACT:
                tau = _impact_phase(y, n, segment, tau, until, system, law, p, control, view, out, impacts, stuck, fast)
            else:
                tau = one_mass(y, n, segment, tau, until, system, mass, with_grain, control, view, out)
            y[at.TIME] = start + tau
            if steps_used(n) >= control.budget:
                return Outcome.STEP_BUDGET
            fault = _fault(fidelity, y, segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau, diameter)
            if fault != Outcome.DONE:
                return fault
            stuck = stuck + 1 if tau == before else np.int64(0)
            if stuck > STALLED:
                return Outcome.STALLED
        if length < end - start:
            return Outcome.CEILING_CRUSHES
        y[at.TIME] = end
    return Outcome.DONE


@kernel
def integrate(run, table, y, n, window, sampling, out, impacts, budget):
    """Integrate through the drive table (rows, DRIVE_COLUMNS) from y[TIME] to its end; returns an outcome's value.

    run: (fidelity, system, mass, law, parameters, rtol, contacts), the mass what moves at the fidelity `simplified`
    [kg], contacts the table of the fidelity `finite`; `window`: (from, to) [s], both row edges of the table where
    extremes shall be exact; `sampling`: (first instant, period) [s]; `out`: series (SAMPLE_ROWS, samples); `impacts`:
    log (capacity, IMPACT_COLUMNS); `budget`: steps. y and n are the state (`columns`), changed in place, also when the
    run ends early. Fidelity and outcome pass as plain integers: numba converts a member of an enumeration in 10 us.
    """
    control = _control(run, table, budget, y)
    return _integrate(run, run[2], table, control, y, n, window, sampling, out, impacts).value


@kernel
def integrate_alike(run, tables, common, masses, y, n, window, sampling, outs, budget, outcomes):
    """Integrate runs of one system that begin alike, each through its own of `tables` (runs, rows, DRIVE_COLUMNS).

    y (runs, STATE_SIZE), n (runs, COUNTERS): their states, the same at first, changed in place; the first `common` rows
    of all tables, which are the same and lie before the window and the first sample, are integrated once. The support
    moves alike in all. masses (runs,): what moves at the fidelity `simplified` [kg]; outs (runs, SAMPLE_ROWS, samples):
    series; outcomes (runs,): the outcomes' values. Nothing is logged; the rest as in `integrate`.
    """
    none, impacts = np.zeros((at.SAMPLE_ROWS, 0)), np.zeros((0, at.IMPACT_COLUMNS))
    control = _control(run, tables[0], budget, y[0])
    begun = _integrate(run, masses[0], tables[0, :common], control, y[0], n[0], window, sampling, none, impacts)
    for k in range(tables.shape[0] - 1, -1, -1):  # the first last: the others go on from its state
        y[k], n[k] = y[0], n[0]
        ended = begun
        if begun == Outcome.DONE:
            ended = _integrate(run, masses[k], tables[k], control, y[k], n[k], window, sampling, outs[k], impacts)
        outcomes[k] = ended.value


@kernel
def pass_sections(run, table, sections, before, after, budget):
    """Map states of free flight, `before` (runs, n) as `sections` lays them out [SI units], through the table.

    The runs beyond those of `before` go on from the one before. `after` (runs, n) gets their ends; returns how many it
    has, and the outcome's value of the next one, or IN_CONTACT. The rest as in `integrate`.
    """
    window, sampling = (math.inf, math.inf), (0.0, 1.0)
    out, impacts = np.zeros((at.SAMPLE_ROWS, 0)), np.zeros((0, at.IMPACT_COLUMNS))
    y, n = np.empty(sections.flight.size), np.zeros(at.COUNTERS, dtype=np.int64)
    for k in range(after.shape[0]):
        y[:] = sections.flight
        n[:] = 0
        n[at.MODE] = at.FREE
        enter_section(run[1].modes, sections, before[k] if k < before.shape[0] else after[k - 1], y)
        control = _control(run, table, budget, y)
        ended = _integrate(run, run[2], table, control, y, n, window, sampling, out, impacts)
        if ended != Outcome.DONE:
            return k, ended.value
        if n[at.MODE] != at.FREE:
            return k, IN_CONTACT
        leave_section(sections, y, after[k])
    return after.shape[0], 0
