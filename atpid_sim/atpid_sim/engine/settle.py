# SPDX-License-Identifier: Apache-2.0
"""Hops too low to matter: after very many the grain is laid to rest on its wall.

An elastic grain that was once lifted hops for ever, 10^5 times a second where the hops are low. Each hop lower than the
error the tolerance allows an overlap moves the beam by less than that; a thousand of them are not on the way to
anything. What the grain still had is entered as lost in the contact.
"""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import energy
from atpid_sim.engine.drive import HEIGHT, HEIGHT_RATE, OMEGA, PHASE
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.release import resting_overlap
from atpid_sim.engine.state import (
    BEAM,
    BEAM_RATE,
    CEILING_WORK,
    CONTACT_LOSS,
    GRAIN,
    GRAIN_RATE,
    LOW_HOPS,
    MEMORY,
    MODE,
    ON_FLOOR,
)
from atpid_sim.engine.step import support_ahead

#: Low hops before which none is taken for idle: bounces that die by themselves are a few, or a few dozen.
_PATIENCE = 1000

#: Low hops that one higher one outweighs: in passing its rest a beam that swings slowly makes every hop a high one.
_OUTWEIGHED = 10


@kernel
def _pull(y, segment, tau, system):  # type: ignore[no-untyped-def]
    """Force of spring and damper on the beam [N]."""
    angle = segment[OMEGA] * tau + segment[PHASE]
    u, w = support_ahead(segment, tau, 0.0, math.sin(angle), math.cos(angle))
    return system.stiffness * (u - y[BEAM]) - system.damping * (y[BEAM_RATE] - w)


@kernel
def _closing(y, side, height_rate):  # type: ignore[no-untyped-def]
    """Speed at which the grain comes to its wall [m/s]."""
    return y[BEAM_RATE] - y[GRAIN_RATE] if side > 0.0 else y[GRAIN_RATE] - y[BEAM_RATE] - height_rate


@kernel
def hops_idly(y, n, segment, tau, system, share):  # type: ignore[no-untyped-def]
    """Count a flight that ended at local time tau where it came no further than `share` of the swing from its wall.

    Returns whether nearly all of the last ones were so low, and wall and grain press together here.
    """
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    rest = -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    swing = abs(y[BEAM] - rest) + abs(y[BEAM_RATE]) / math.sqrt(system.stiffness / system.beam_mass)
    play = segment[HEIGHT] + segment[HEIGHT_RATE] * tau - 2.0 * system.radius
    pressing = side * _pull(y, segment, tau, system) / system.beam_mass
    closing = _closing(y, side, segment[HEIGHT_RATE])
    low = play <= share * swing or (pressing > 0.0 and closing * closing <= 2.0 * pressing * share * swing)
    n[LOW_HOPS] = n[LOW_HOPS] + 1 if low else max(0, n[LOW_HOPS] - _OUTWEIGHED)
    return low and n[LOW_HOPS] > _PATIENCE and pressing > 0.0


@kernel
def settle(y, n, segment, tau, system, law, p):  # type: ignore[no-untyped-def]
    """Lay a grain that has just touched its wall to rest there: common velocity, overlap where the forces balance.

    Leaves everything as it is where that would take energy from nowhere.
    """
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    moving = 0.0 if side > 0.0 else segment[HEIGHT_RATE]
    beam_mass, grain_mass = system.beam_mass, system.grain_mass
    closing = _closing(y, side, segment[HEIGHT_RATE])
    impulse = beam_mass * grain_mass / (beam_mass + grain_mass) * closing
    push = side * grain_mass / (beam_mass + grain_mass) * _pull(y, segment, tau, system)
    overlap = resting_overlap(law, p, push, 1e-12)
    kinetic = 0.5 * impulse * closing
    lost = kinetic + side * grain_mass * system.gravity * overlap - energy(law, overlap, overlap, p)
    if not (push > 0.0 and lost >= 0.0):
        return
    y[BEAM_RATE] -= side * impulse / beam_mass
    y[GRAIN_RATE] = y[BEAM_RATE] + moving
    y[GRAIN] -= side * overlap
    y[MEMORY] = overlap
    y[CONTACT_LOSS] += lost
    y[CEILING_WORK] -= moving * impulse
