# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fidelity `finite`: a contact of finite duration in one step, from a table of its scaled problem.

The table has overlap and velocity at detachment. The first two integrals of the force, which move beam and grain,
follow from these, since momentum is conserved: what free motion would have given, less what the contact left.
"""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.contact.dispatch import detachment_velocity
from atpid_sim.contact.laws import HYSTERETIC
from atpid_sim.engine import columns as at
from atpid_sim.engine import scaled_contact as result
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.contact_phase import contact
from atpid_sim.engine.contact_table import COLUMNS, read
from atpid_sim.engine.detachment import static_overlap
from atpid_sim.engine.impact_phase import deepen_if_pressed, stick
from atpid_sim.engine.micro_bounce import closing_speed
from atpid_sim.engine.sampling import next_sample, record_extreme
from atpid_sim.kernel import kernel, lean
from atpid_sim.system import System

#: A contact longer than this many radians of the fastest vibration is integrated: its own time is no longer short.
_LONGEST = 0.3
#: Share of the deepest overlap below which what remains at detachment is rounding.
_PARTED = 1e-6
#: Overlap's fundamental over the overlap at the peak of a force that swings as a sine, for overlaps as its power 2/3.
_FUNDAMENTAL = 1.07
#: Mean square of a rising impulse over the square of its mean.
_RISE = 1.2


class _Touch(NamedTuple):
    """Motion of beam and support at the touch, and as it would go on without contact [SI units]."""

    v: float  # of the beam
    a: float
    jerk: float
    snap: float
    w: float  # velocity of the support
    support_a: float
    support_jerk: float


class _Recoil(NamedTuple):
    """What a contact has done by its detachment [SI units]: integrals of the force over the reduced mass."""

    duration: float
    impulse: float
    shift: float
    third: float
    fourth: float


@lean
def _touch(y, segment, tau, system):
    """Motion at the touch at local time tau."""
    u, w = support_at(segment, tau)
    support_a, support_jerk = 2.0 * segment[at.C2] + 6.0 * segment[at.C3] * tau, 6.0 * segment[at.C3]
    if segment[at.A0] != 0.0 or segment[at.A1] != 0.0:
        omega, angle = segment[at.OMEGA], segment[at.OMEGA] * tau + segment[at.PHASE]
        amplitude, s, c = segment[at.A0] + segment[at.A1] * tau, math.sin(angle), math.cos(angle)
        support_a += omega * (2.0 * segment[at.A1] * c - omega * amplitude * s)
        support_jerk -= omega * omega * (3.0 * segment[at.A1] * s + omega * amplitude * c)
    v, stiffness, damping, mass = y[at.BEAM_VELOCITY], system.stiffness, system.damping, system.beam_mass
    a = (stiffness * (u - y[at.BEAM]) - damping * (v - w)) / mass - system.gravity
    jerk = (stiffness * (w - v) + damping * (support_a - a)) / mass
    snap = (stiffness * (support_a - a) + damping * (support_jerk - jerk)) / mass
    return _Touch(v, a, jerk, snap, w, support_a, support_jerk)


@kernel
def _inside(y, n, segment, tau, end, system, law, p, control, view, out):
    """Samples and the beam's turning point inside a contact, from integrating it aside."""
    aside, counts = y.copy(), n.copy()
    contact(aside, counts, segment, tau, end, system, law, p, control, view, out)
    n[at.SAMPLE] = counts[at.SAMPLE]
    if view.observing:
        y[at.LOWEST], y[at.HIGHEST] = aside[at.LOWEST], aside[at.HIGHEST]


@lean
def _enter_flows(y, system, touch, recoil, side, moving):
    """Enter a contact into the energy ledger: work of the support and the ceiling, loss of the beam's damper."""
    d, mass = recoil.duration, system.beam_mass
    share = system.grain_mass / (mass + system.grain_mass)
    # integral of (p0 + p1 t + p2 t^2 / 2)(w0 + w1 t + w2 t^2 / 2), and of the pull that the recoil adds
    p0, p1, p2 = mass * (touch.a + system.gravity), mass * touch.jerk, mass * touch.snap
    w0, w1, w2 = touch.w, touch.support_a, touch.support_jerk
    work = d * (p0 * w0 + d * (p0 * w1 + p1 * w0) / 2.0)
    work += d**3 * ((0.5 * (p0 * w2 + p2 * w0) + p1 * w1) / 3.0 + d * (p1 * w2 + p2 * w1) / 8.0)
    added = system.damping * recoil.shift + system.stiffness * recoil.third
    y[at.INPUT] += work + side * share * (w0 + 0.5 * d * w1) * added
    s0, s1, s2 = touch.v - w0, touch.a - w1, touch.jerk - w2
    slip = d * (s0 * s0 + d * (s0 * s1 + d * (s1 * s1 + s0 * s2) / 3.0))
    crossed = s0 * recoil.shift + s1 * (d * recoil.shift - recoil.third)
    squared = _RISE * recoil.shift * recoil.shift / d
    y[at.BEAM_LOSS] += system.damping * (slip - 2.0 * side * share * crossed + share * share * squared)
    y[at.CEILING_WORK] -= moving * share * mass * recoil.impulse


@lean
def _detach(y, n, segment, tau, system, law, p, side, moving, overlap, velocity):
    """Enter grain and mode at the detachment at local time tau, given the beam."""
    deepest = y[at.DEEPEST]
    undamped = not HYSTERETIC[law] and detachment_velocity(law, overlap, deepest, p) == -math.inf
    if undamped or overlap < _PARTED * deepest:
        overlap, velocity = 0.0, min(velocity, 0.0)
        n[at.MODE] = at.FREE
    else:
        n[at.MODE] = at.OFF_FLOOR if side > 0.0 else at.OFF_CEILING
    if side > 0.0:
        y[at.GRAIN], y[at.GRAIN_VELOCITY] = y[at.BEAM] - overlap, y[at.BEAM_VELOCITY] - velocity
    else:
        clearance = segment[at.HEIGHT] + moving * tau - 2.0 * system.radius
        y[at.GRAIN] = y[at.BEAM] + clearance + overlap
        y[at.GRAIN_VELOCITY] = y[at.BEAM_VELOCITY] + velocity + moving


@kernel
def hold(y, n, segment, tau, until, system, law, p, control, view, out):
    """Advance a grain held by floor and ceiling by at most a cycle; returns the local time reached.

    Beam and grain are one mass. The contact's compliance, in the fundamental of a swing as large as the present one, is
    added in series with the beam's spring: without it the phase at resonance is off by a thousandth of a radian.
    """
    beam, grain, stiffness, damping, gravity, radius, modes = system
    total = beam + grain
    touch = _touch(y, segment, tau, System(total, 0.0, stiffness, damping, gravity, radius, None))
    tone = segment[at.OMEGA] if segment[at.A0] != 0.0 or segment[at.A1] != 0.0 else 0.0
    pace = max(tone, math.sqrt(stiffness / total))
    push = grain * math.sqrt(touch.a * touch.a + pace * pace * touch.v * touch.v)
    give = 0.0
    if push > 0.0:
        give = _FUNDAMENTAL * static_overlap(law, p, push, 1e-3) / push * (grain / total) ** 2
    deepen_if_pressed(y, push, pace, system, law, p)
    left = 1.0 / (1.0 + give * stiffness)
    softer = System(beam, grain, left * stiffness, left * damping, gravity, radius, modes)
    return stick(y, n, segment, tau, min(until, tau + 2.0 * math.pi / pace), softer, control, view, out)


@kernel
def tabulated_contact(y, n, segment, tau, until, system, law, p, control, view, out, table):
    """Advance a contact that begins at local time tau to its detachment; returns that time, or tau: not in the table.

    Leaves y at that time and n[MODE] at what follows, as `contact` does.
    """
    if system.modes is not None:
        return tau  # integrated: the table has one mode
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    moving = 0.0 if side > 0.0 else segment[at.CEILING_VELOCITY]
    share = system.grain_mass / (system.beam_mass + system.grain_mass)  # the reduced mass over the beam's
    chi, eta = share * system.damping / system.beam_mass, share * system.stiffness / system.beam_mass
    touch = _touch(y, segment, tau, system)
    speed = closing_speed(y, side, segment[at.CEILING_VELOCITY])
    b, rate, curvature = side * (touch.a + system.gravity), side * touch.jerk, side * touch.snap
    found = np.empty(COLUMNS)
    if not read(table, speed, b, rate, curvature, chi, eta, found) or found[result.DEEPEST] > system.radius:
        return tau
    d, overlap = found[result.DURATION], found[result.OVERLAP]
    velocity, third = found[result.VELOCITY], found[result.THIRD]
    tone = segment[at.OMEGA] if segment[at.A0] != 0.0 or segment[at.A1] != 0.0 else 0.0
    if tau + d > until or d * max(tone, math.sqrt(system.stiffness / system.beam_mass)) > _LONGEST:
        return tau
    fourth = 0.25 * d * third
    shift = d * (speed + d * (b / 2.0 + d * (rate / 6.0 + d * curvature / 24.0))) - overlap + chi * third + eta * fourth
    impulse = speed + d * (b + d * (rate / 2.0 + d * curvature / 6.0)) - velocity + chi * shift + eta * third
    x, v, a = y[at.BEAM], touch.v, touch.a
    x1 = x + d * (v + d * (a / 2.0 + d * (touch.jerk / 6.0 + d * touch.snap / 24.0)))
    x1 += side * (chi * third + eta * fourth - share * shift)
    v1 = v + d * (a + d * (touch.jerk / 2.0 + d * touch.snap / 6.0))
    v1 += side * (chi * shift + eta * third - share * impulse)
    if next_sample(n, out, view) <= tau + d or (view.observing and v * v1 < 0.0):
        _inside(y, n, segment, tau, tau + d, system, law, p, control, view, out)
    _enter_flows(y, system, touch, _Recoil(d, impulse, shift, third, fourth), side, moving)
    # what the relative acceleration does on the overlap: its end value times the overlap left, less its change
    changed = d * (rate + 0.5 * d * curvature) + chi * impulse + eta * shift
    worked = (b + changed) * overlap - changed / d * found[result.MEAN]
    lost = share * system.beam_mass * (0.5 * (speed * speed - velocity * velocity) + worked)
    y[at.CONTACT_LOSS] += max(0.0, lost)  # a law only dissipates; an elastic one loses less than the table's error
    n[at.CONTACT_STEPS] += 1
    y[at.BEAM], y[at.BEAM_VELOCITY], y[at.DEEPEST] = x1, v1, found[result.DEEPEST]
    _detach(y, n, segment, tau + d, system, law, p, side, moving, overlap, velocity)
    if view.observing:
        y[at.CONTACT_TIME] += d
        y[at.LONGEST] = max(y[at.LONGEST], d)
        record_extreme(y, x1)
    return tau + d
