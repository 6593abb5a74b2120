# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Micro-bounces: after very many the grain is put into static contact with its wall.

An elastic grain that was once lifted bounces without end, 10^5 times a second where the bounces are low. A bounce lower
than the error that the tolerance allows an overlap moves the beam by less than that; after a thousand of them they are
replaced by static contact. The remaining energy of the grain is entered as lost in the contact.
"""

import math

from atpid_sim.contact.dispatch import energy
from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.detachment import static_overlap
from atpid_sim.engine.dormand_prince import support_ahead
from atpid_sim.engine.modes import container_mass, free_acceleration, kick, resting_place, states_of
from atpid_sim.kernel import kernel

#: Low bounces before static contact: bounces that die out by themselves are a few, or a few dozen.
LIMIT = 1000
#: Low bounces that one higher one cancels: near its equilibrium a slowly moving beam makes every bounce a high one.
OUTWEIGHED = 10


@kernel
def _support_force(modes, y, segment, tau, system):
    """Force of spring and damper on the beam [N]; of several modes, that on one mass as an impulse meets."""
    if modes is not None:
        u, w = support_at(segment, tau)
        return container_mass(modes, system) * free_acceleration(modes, states_of(modes, y), u, w)
    angle = segment[at.OMEGA] * tau + segment[at.PHASE]
    u, w = support_ahead(segment, tau, 0.0, math.sin(angle), math.cos(angle))
    return system.stiffness * (u - y[at.BEAM]) - system.damping * (y[at.BEAM_VELOCITY] - w)


@kernel
def closing_speed(y, side, ceiling_velocity):
    """Closing speed of grain and wall [m/s]."""
    if side > 0.0:
        return y[at.BEAM_VELOCITY] - y[at.GRAIN_VELOCITY]
    return y[at.GRAIN_VELOCITY] - y[at.BEAM_VELOCITY] - ceiling_velocity


@kernel
def only_micro_bounces(y, n, segment, tau, system, share):
    """Count a flight that ended at local time tau if its height was below `share` of the beam's displacement.

    Returns whether nearly all of the last flights were so low, and wall and grain press together now.
    """
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    rest = resting_place(system.modes, system)
    size = abs(y[at.BEAM] - rest) + abs(y[at.BEAM_VELOCITY]) / math.sqrt(system.stiffness / system.beam_mass)
    clearance = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau - 2.0 * system.radius
    pressing = side * _support_force(system.modes, y, segment, tau, system) / container_mass(system.modes, system)
    closing = closing_speed(y, side, segment[at.CEILING_VELOCITY])
    low = clearance <= share * size or (pressing > 0.0 and closing * closing <= 2.0 * pressing * share * size)
    n[at.LOW_HOPS] = n[at.LOW_HOPS] + 1 if low else max(0, n[at.LOW_HOPS] - OUTWEIGHED)
    return low and n[at.LOW_HOPS] > LIMIT and pressing > 0.0


@kernel
def replace_by_static_contact(y, n, segment, tau, system, law, p):
    """Put a grain that has just touched its wall into static contact: common velocity, overlap of force balance.

    Changes nothing where that would need energy.
    """
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    moving = 0.0 if side > 0.0 else segment[at.CEILING_VELOCITY]
    beam_mass, grain_mass = container_mass(system.modes, system), system.grain_mass
    closing = closing_speed(y, side, segment[at.CEILING_VELOCITY])
    impulse = beam_mass * grain_mass / (beam_mass + grain_mass) * closing
    push = side * grain_mass / (beam_mass + grain_mass) * _support_force(system.modes, y, segment, tau, system)
    overlap = static_overlap(law, p, push, 1e-12)
    kinetic = 0.5 * impulse * closing
    lost = kinetic + side * grain_mass * system.gravity * overlap - energy(law, overlap, overlap, p)
    if not (push > 0.0 and lost >= 0.0):
        return
    y[at.BEAM_VELOCITY] -= side * impulse / beam_mass
    kick(system.modes, y, -side * impulse)
    y[at.GRAIN_VELOCITY] = y[at.BEAM_VELOCITY] + moving
    y[at.GRAIN] -= side * overlap
    y[at.DEEPEST] = overlap
    y[at.CONTACT_LOSS] += lost
    y[at.CEILING_WORK] -= moving * impulse
