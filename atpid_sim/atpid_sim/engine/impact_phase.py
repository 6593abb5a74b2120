# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fidelity `impact`: instantaneous impacts with the law's restitution, and sticking as one mass."""

import math

from atpid_sim.contact.dispatch import force, restitution
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import columns as at
from atpid_sim.engine.beam import beam_at, fastest_of, snap_bounded_at
from atpid_sim.engine.micro_bounce import only_micro_bounces
from atpid_sim.engine.modes import container_mass, free_arc, grain_acceleration, joined_arc, kick, leave_joined
from atpid_sim.engine.safe_step import safe_velocity_step
from atpid_sim.engine.sampling import flight_extreme, joint_samples, record_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.engine.work import joined_work
from atpid_sim.kernel import kernel

#: Bounces that would all be over within this many radians of the fastest vibration are taken as one: the grain sticks.
STICKING = 0.01
#: A clearance below this share of the grain's radius is none: no contact is so shallow, and elastic bounces never end.
NO_CLEARANCE = 1e-5
#: A closing speed below this share of push / fastest is none: elastic grains too come to rest.
NO_SPEED = 1e-9
#: Impacts at one and the same instant after which the grain sticks: its bounces are shorter than the clock resolves.
COLLAPSE = 50
#: Bounces below this share of the beam's displacement are low.
LOW = 1e-8


@kernel
def begin_impact_row(y, n, segment):
    """At a row's start: a ceiling that has changed its velocity departs from the grain or hits it."""
    if n[at.MODE] == at.ON_CEILING and y[at.GRAIN_VELOCITY] - y[at.BEAM_VELOCITY] != segment[at.CEILING_VELOCITY]:
        n[at.MODE] = at.FREE


@kernel
def is_held(segment, tau, system):
    """Whether floor and ceiling hold the grain: there is no clearance and the ceiling is not opening."""
    clearance = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau - 2.0 * system.radius
    return segment[at.CEILING_VELOCITY] <= 0.0 and clearance <= NO_CLEARANCE * system.radius


@kernel
def deepen_if_pressed(y, push, pace, system, law, p):
    """Enter that a held grain, shaken with `push` [N] and its weight, is pressed deeper than its radius, if it is.

    pace: angular frequency of the shaking [rad/s], at which the contact's damping holds against it as well.
    """
    push += system.grain_mass * system.gravity
    if law == IMPACT:
        return
    radius = system.radius
    elastic = force(law, radius, 0.0, radius, p)
    damping = force(law, radius, pace * radius, radius, p) - elastic
    if push > math.hypot(elastic, damping):
        y[at.DEEPEST] = math.inf


@kernel
def press_held(y, segment, tau, system, law, p):
    """`deepen_if_pressed` for the present swing of a grain that moves with the beam as one mass."""
    total = system.beam_mass + system.grain_mass
    arc = joined_arc(system.modes, y, total, system, segment, tau)
    pace = fastest_of(arc)
    push = system.grain_mass * math.hypot(beam_at(arc, tau)[2], pace * y[at.BEAM_VELOCITY])
    deepen_if_pressed(y, push, pace, system, law, p)


@kernel
def collide(y, n, segment, tau, system, law, p, stuck):
    """Exchange momentum at the wall of n[MODE] (equations 3.6 and 3.7); the mode becomes FREE unless the grain sticks.

    `stuck`: impacts at this very instant so far. Returns how long the bounces last that sticking replaces [s].
    """
    arc = free_arc(system.modes, y, system.beam_mass, system, segment, tau)
    replaced = only_micro_bounces(y, n, segment, tau, system, LOW) or stuck > COLLAPSE
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    moving = 0.0 if side > 0.0 else segment[at.CEILING_VELOCITY]
    closing = side * (y[at.BEAM_VELOCITY] + moving - y[at.GRAIN_VELOCITY])
    beam_mass = container_mass(system.modes, system)
    reduced = beam_mass * system.grain_mass / (beam_mass + system.grain_mass)
    e = restitution(law, closing, reduced, p) if closing > 0.0 else 0.0
    push = side * (beam_at(arc, tau)[2] + system.gravity)  # with which beam and grain press together
    fastest = fastest_of(arc)
    # the bounces that follow last 2 e v / (push (1 - e)) in all, a geometric series
    rounding = -1e-12 * (abs(push) + system.gravity) if closing == 0.0 else 0.0
    slow = max(push, 0.0) * max(NO_SPEED, STICKING * (1.0 - e) / max(2.0 * e, 1e-300))
    held = is_held(segment, tau, system) or replaced
    sticks = held or (push >= rounding and closing * fastest <= slow)
    bounces = 0.0
    if sticks:
        if not held and push > 0.0 and e < 1.0:
            bounces = min(2.0 * e * closing / (push * (1.0 - e)), STICKING / fastest)
        e = 0.0
    impulse = max(0.0, (1.0 + e) * reduced * closing)
    y[at.BEAM_VELOCITY] -= side * impulse / beam_mass
    kick(system.modes, y, -side * impulse)
    y[at.GRAIN_VELOCITY] += side * impulse / system.grain_mass
    if side * (y[at.BEAM_VELOCITY] + moving - y[at.GRAIN_VELOCITY]) > 0.0:
        y[at.GRAIN_VELOCITY] = y[at.BEAM_VELOCITY] + moving  # rounding of a plastic impact
    y[at.CONTACT_LOSS] += 0.5 * reduced * (1.0 - e * e) * closing * closing
    y[at.CEILING_WORK] -= moving * impulse
    if not sticks:
        n[at.MODE] = at.FREE
    return bounces


@kernel
def stick(y, n, segment, tau, until, system, control, view, out):
    """Advance beam and grain as one mass until the wall would have to pull, or the row ends; returns the local time.

    On a moving ceiling too the beam moves as with the combined mass: the ceiling's velocity is constant in a row.
    """
    held = is_held(segment, tau, system)
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    total = system.beam_mass + system.grain_mass
    diameter = 2.0 * system.radius
    begin, start_velocity = tau, y[at.GRAIN_VELOCITY]
    arc = joined_arc(system.modes, y, total, system, segment, tau)
    stride = 1.0 / fastest_of(arc)
    x, v, a, jerk, snap = snap_bounded_at(arc, tau, until)
    pressing = side * grain_acceleration(system.modes, system, segment, arc, tau, a)
    least = 1e-9 * stride
    # a first step is made in any case: whether the wall presses at the instant of impact depends on rounding
    while (pressing >= 0.0 or tau == begin or held) and tau < until and steps_used(n) < control.budget:
        n[at.CONTACT_STEPS] += 1
        # held and unobserved, nothing can happen on the way
        longest = until - tau if held and not view.observing else min(stride, until - tau)
        # the wall surely presses this long: the force's rate of change is known, and that changes by the snap at most
        step = longest if held else max(safe_velocity_step(pressing, -side * jerk, snap, longest), least)
        ahead = until if step >= until - tau else tau + step
        x1, v1, a, jerk, snap = snap_bounded_at(arc, ahead, until)
        pressing = side * grain_acceleration(system.modes, system, segment, arc, ahead, a)
        if view.observing:
            y[at.CONTACT_TIME] += ahead - tau
            record_extreme(y, x1)
            if v * v1 < 0.0:
                flight_extreme(y, arc, tau, ahead, v, v1)
        x, v, tau = x1, v1, ahead
    moving = 0.0 if side > 0.0 else segment[at.CEILING_VELOCITY]
    gap = 0.0 if side > 0.0 else segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau - diameter
    joined_work(system.modes, y, segment, system, arc, begin, tau)
    leave_joined(system.modes, y, arc, tau)
    joint_samples(n, out, view, segment, arc, tau, side, diameter)
    y[at.BEAM], y[at.BEAM_VELOCITY] = x, v
    y[at.GRAIN], y[at.GRAIN_VELOCITY] = x + gap, v + moving
    gained = y[at.GRAIN_VELOCITY] - start_velocity + system.gravity * (tau - begin)
    y[at.CEILING_WORK] += moving * system.grain_mass * gained
    if pressing < 0.0 and not held:
        n[at.MODE] = at.FREE
    return tau
