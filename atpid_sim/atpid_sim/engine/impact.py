# SPDX-License-Identifier: Apache-2.0
"""The `impact` rung: exact flight, instantaneous impacts with the law's restitution, sticking as one mass."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from atpid_sim.contact import Contact
from atpid_sim.contact.dispatch import restitution
from atpid_sim.engine.advance import safe_rate_step
from atpid_sim.engine.beam import arc_from, beam_at, snap_bounded_at
from atpid_sim.engine.drive import END, HEIGHT, HEIGHT_RATE, START
from atpid_sim.engine.flight import fly
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.observe import flight_extreme, flight_work, note_extreme, write_sample
from atpid_sim.engine.settle import hops_idly
from atpid_sim.engine.soft import CEILING_CRUSHES, DONE, NOT_FINITE, STALLED, STEP_BUDGET, log_impact, sound_length
from atpid_sim.engine.state import (
    BEAM,
    BEAM_RATE,
    CEILING_WORK,
    CONTACT_LOSS,
    CONTACT_STEPS,
    FREE,
    GRAIN,
    GRAIN_RATE,
    MODE,
    ON_CEILING,
    ON_FLOOR,
    SAMPLE,
    TIME,
    TOUCHING,
    spent,
)
from atpid_sim.outcome import Outcome
from atpid_sim.system import System

if TYPE_CHECKING:
    from atpid_sim.run import Stepper

#: Bounces that would all be over within this many radians of the fastest swing are taken as one: the grain sticks.
_SETTLED = 0.01

#: Play below this share of the grain's radius is none: no contact is so shallow, and elastic bounces never end.
_NO_PLAY = 1e-5

#: A closing speed below this share of push / fastest is none: elastic grains too come to rest.
_STILL = 1e-9

#: Impacts at one and the same instant after which no more are to come: bounces have died within the clock's rounding.
_COLLAPSE = 50

#: Hops below this share of the swing are low.
_LOW = 1e-8


def impact_stepper(system: System, contact: Contact) -> Stepper:
    """Return the stepper of this rung; a law with a force is represented by its restitution."""

    def run(table, y, n, observe, sampling, out, events, budget):  # type: ignore[no-untyped-def]
        law, p = contact
        return Outcome(run_impacts(table, system, law, p, y, n, observe, sampling, out, events, budget))

    return run


@kernel
def _held(segment, tau, system):  # type: ignore[no-untyped-def]
    """Whether floor and ceiling leave the grain no play: one that opens gives it at once, the last is taken at once."""
    room = segment[HEIGHT] + segment[HEIGHT_RATE] * tau - 2.0 * system.radius
    return segment[HEIGHT_RATE] <= 0.0 and room <= _NO_PLAY * system.radius


@kernel
def _collide(y, n, arc, tau, system, law, p, height_rate, held, idle):  # type: ignore[no-untyped-def]
    """Exchange momentum at the wall of n[MODE] (equations 3.6 and 3.7); the mode becomes FREE unless the grain sticks.

    `held`: floor and ceiling leave it no play; `idle`: it has long been hopping too low to matter.
    """
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    moving = 0.0 if side > 0.0 else height_rate
    closing = side * (y[BEAM_RATE] + moving - y[GRAIN_RATE])
    reduced = system.beam_mass * system.grain_mass / (system.beam_mass + system.grain_mass)
    e = restitution(law, closing, reduced, p) if closing > 0.0 else 0.0
    push = side * (beam_at(arc, tau)[2] + system.gravity)  # with which beam and grain press together
    fastest = max(arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0, math.sqrt(system.stiffness / system.beam_mass))
    # the bounces that follow last 2 e v / (push (1 - e)) in all, a geometric series
    rounding = -1e-12 * (abs(push) + system.gravity) if closing == 0.0 else 0.0
    still = max(push, 0.0) * max(_STILL, _SETTLED * (1.0 - e) / max(2.0 * e, 1e-300))
    sticks = held or idle or (push >= rounding and closing * fastest <= still)
    if sticks:
        e = 0.0
    impulse = max(0.0, (1.0 + e) * reduced * closing)
    y[BEAM_RATE] -= side * impulse / system.beam_mass
    y[GRAIN_RATE] += side * impulse / system.grain_mass
    if side * (y[BEAM_RATE] + moving - y[GRAIN_RATE]) > 0.0:
        y[GRAIN_RATE] = y[BEAM_RATE] + moving  # what rounding leaves of a plastic impact
    y[CONTACT_LOSS] += 0.5 * reduced * (1.0 - e * e) * closing * closing
    y[CEILING_WORK] -= moving * impulse
    if not sticks:
        n[MODE] = FREE


@kernel
def _stick(y, n, segment, tau, until, system, held, observing, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Carry beam and grain as one mass until the wall would have to pull, or the row ends; returns the local time.

    On a moving ceiling too the beam moves as with the combined mass, since the ceiling's rate is constant in a row.
    """
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    height, height_rate = segment[HEIGHT], segment[HEIGHT_RATE]
    total = system.beam_mass + system.grain_mass
    slack = 2.0 * system.radius
    begin, start_rate = tau, y[GRAIN_RATE]
    arc = arc_from(total, system.stiffness, system.damping, system.gravity, segment, tau, y[BEAM], y[BEAM_RATE])
    stride = 1.0 / max(arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0, math.sqrt(system.stiffness / total))
    x, v, a, jerk, snap = snap_bounded_at(arc, tau, until)
    pressing = side * (a + system.gravity)
    least = 1e-9 * stride
    # a first step is made in any case: whether the wall presses at the very impact is a matter of rounding
    while (pressing >= 0.0 or tau == begin or held) and tau < until and spent(n) < budget:
        n[CONTACT_STEPS] += 1
        longest = min(stride, until - tau)
        # the wall surely presses this long: its rate of change is known, and changes no faster than the snap
        step = longest if held else max(safe_rate_step(pressing, -side * jerk, snap, longest), least)
        ahead = until if step >= until - tau else tau + step
        x1, v1, a, jerk, snap = snap_bounded_at(arc, ahead, until)
        pressing = side * (a + system.gravity)
        if observing:
            y[TOUCHING] += ahead - tau
            note_extreme(y, x1)
            if v * v1 < 0.0:
                flight_extreme(y, arc, tau, ahead, v, v1)
        x, v, tau = x1, v1, ahead
    moving = 0.0 if side > 0.0 else height_rate
    lift = 0.0 if side > 0.0 else height + height_rate * tau - slack
    flight_work(y, arc, begin, tau)
    while n[SAMPLE] < out.shape[1]:
        at = sampling[0] + n[SAMPLE] * sampling[1] - sampling[2]
        if at > tau:
            break
        xs, vs, acceleration, u, _w = beam_at(arc, at)
        ceiling = height + height_rate * at
        write_sample(out, n[SAMPLE], u, xs, vs, acceleration, xs if side > 0.0 else xs + ceiling - slack, ceiling)
        n[SAMPLE] += 1
    y[BEAM], y[BEAM_RATE] = x, v
    y[GRAIN], y[GRAIN_RATE] = x + lift, v + moving
    y[CEILING_WORK] += moving * system.grain_mass * (y[GRAIN_RATE] - start_rate + system.gravity * (tau - begin))
    if pressing < 0.0 and not held:
        n[MODE] = FREE
    return tau


@kernel
def run_impacts(table, system, law, p, y, n, observe, sampling, out, events, budget):  # type: ignore[no-untyped-def]
    """Integrate through the drive table with instantaneous impacts; arguments and result as `soft.run`."""
    slack = 2.0 * system.radius
    stuck = 0
    for row in range(table.shape[0]):
        segment = table[row]
        start, end = segment[START], segment[END]
        if end <= y[TIME]:
            continue
        length = sound_length(segment, slack)
        observing = observe[0] <= 0.5 * (start + end) <= observe[1]
        if observing:
            note_extreme(y, y[BEAM])
        tau, until = y[TIME] - start, length
        where = (sampling[0], sampling[1], start)
        if n[MODE] == ON_CEILING and y[GRAIN_RATE] - y[BEAM_RATE] != segment[HEIGHT_RATE]:
            n[MODE] = FREE  # the ceiling has changed its rate: decide anew whether it is left or hit
        while tau < until:
            before = tau
            held = _held(segment, tau, system)
            if n[MODE] == ON_FLOOR or n[MODE] == ON_CEILING:
                tau = _stick(y, n, segment, tau, until, system, held, observing, where, out, budget)
            else:
                tau = fly(y, n, segment, tau, until, system, law, p, observing, where, out, budget)
                if n[MODE] != FREE:
                    log_impact(y, n, events, start + tau, observing, segment[HEIGHT_RATE])
                    arc = arc_from(system.beam_mass, system.stiffness, system.damping, system.gravity, segment, tau, y[BEAM], y[BEAM_RATE])  # fmt: skip # noqa: E501
                    idle = hops_idly(y, n, segment, tau, system, _LOW) or stuck > _COLLAPSE
                    held = _held(segment, tau, system)
                    _collide(y, n, arc, tau, system, law, p, segment[HEIGHT_RATE], held, idle)
            y[TIME] = start + tau
            if spent(n) >= budget:
                return STEP_BUDGET
            if not (math.isfinite(y[BEAM]) and math.isfinite(y[BEAM_RATE]) and math.isfinite(y[GRAIN_RATE])):
                return NOT_FINITE
            stuck = stuck + 1 if tau == before else 0
            if stuck > 1000:
                return STALLED
        if length < end - start:
            return CEILING_CRUSHES
        y[TIME] = end
    return DONE
