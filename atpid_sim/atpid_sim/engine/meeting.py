# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Impacts of several grains on one structure at one instant, one after the other.

The fastest comes first, those of the same closing speed together; a grain at rest takes part once its wall has been
struck toward it. So each impact has the law's restitution, with the mass that an impulse at that place meets.
"""

from typing import NamedTuple

import numpy as np

from atpid_sim.contact.dispatch import restitution
from atpid_sim.engine import columns as at
from atpid_sim.engine.impact_phase import COLLAPSE, LOW, NO_CLEARANCE, NO_SPEED, STICKING
from atpid_sim.engine.micro_bounce import LIMIT, OUTWEIGHED
from atpid_sim.engine.power_series import inverse_mass
from atpid_sim.kernel import kernel
from atpid_sim.system import Array

#: Closing speeds that differ by less are the same, and those below this share of the velocities are none.
_ALIKE, _NONE = 1e-6, 1e-12
#: A gap below this fraction of the lengths in play is none where another grain lands: those at one place land together.
_NEAR = 1e-10
#: Rounds of impacts at one instant; from `COLLAPSE` on all of them are plastic.
_ROUNDS = 5 * COLLAPSE


class Dampers(NamedTuple):
    """A structure with several dampers, the first at the container that the modes are of."""

    modes: Array  # in flight (SET_ROWS, modes)
    table: Array  # (dampers, DAMPER_COLUMNS)
    shapes: Array  # displacement at the damper over that at the first, in each mode (dampers, modes)
    law: int
    parameters: Array  # of the law (dampers, 6)
    gravity: float  # [m/s^2]
    pace: float  # highest angular frequency of the modes [rad/s]
    rate: float  # bound of how fast their motion changes [1/s]: with the largest damping over mass


@kernel
def side_of(mode):
    """+1 at the floor, -1 at the ceiling."""
    return -1.0 if mode == at.ON_CEILING else 1.0


@kernel
def clearance_of(d, segment, tau, j):
    """Clearance of a grain between floor and ceiling [m], and how fast it grows [m/s]; only the first's may move."""
    if j == 0:
        opening = segment[at.CEILING_VELOCITY]
        return segment[at.HEIGHT] + opening * tau - 2.0 * d.table[0, at.RADIUS], opening
    return d.table[j, at.FIXED_HEIGHT] - 2.0 * d.table[j, at.RADIUS], 0.0


@kernel
def clamps(d, segment, tau, j):
    """Whether floor and ceiling hold a grain: there is no clearance and the ceiling is not opening."""
    clearance, opening = clearance_of(d, segment, tau, j)
    return opening <= 0.0 and clearance <= NO_CLEARANCE * d.table[j, at.RADIUS]


@kernel
def _land(d, wall, segment, tau, which, grains, hits):
    """Put the grain `which`, and others that touch a wall and close on it now, at their walls; returns who landed."""
    landed = np.zeros(len(hits), np.bool_)
    for j in range(len(hits)):
        if hits[j, at.D_MODE] != at.FREE:
            continue
        clearance, opening = clearance_of(d, segment, tau, j)
        gap, parting = grains[j, at.G_PLACE] - wall[j, 0], grains[j, at.G_SPEED] - wall[j, 1]
        touch = _NEAR * (abs(wall[j, 0]) + abs(grains[j, at.G_PLACE]) + 2.0 * d.table[j, at.RADIUS])
        floor, ceiling = gap <= touch and parting < 0.0, clearance - gap <= touch and opening - parting < 0.0
        if j == which and not floor and not ceiling:
            floor = gap <= 0.5 * clearance
            ceiling = not floor
        if floor or ceiling:
            landed[j], hits[j, at.D_MODE] = True, at.ON_FLOOR if floor else at.ON_CEILING
            grains[j, at.G_PLACE] = wall[j, 0] + (0.0 if floor else clearance)
    return landed


@kernel
def _closing(d, segment, states, grains, hits, j):
    """Closing speed of a grain and its wall [m/s], and the size of their velocities."""
    moving = segment[at.CEILING_VELOCITY] if j == 0 and hits[j, at.D_MODE] == at.ON_CEILING else 0.0
    wall = moving
    for i in range(states.shape[0]):
        wall += d.shapes[j, i] * states[i, at.Q_RATE]
    speed = grains[j, at.G_SPEED]
    return side_of(hits[j, at.D_MODE]) * (wall - speed), abs(wall) + abs(speed) + abs(moving), wall


@kernel
def _impulses(d, inverse, hits, struck, wanted, pulling):
    """Impulses (k,) [N s] of the dampers `struck` (k,) that change their closing speeds by `wanted` (k,) [m/s].

    Where one would pull, it is left out, unless `pulling`.
    """
    size = len(struck)
    matrix, impulse = np.empty((size, size)), np.zeros(size)
    for a in range(size):
        moved = inverse @ d.shapes[struck[a]]
        for b in range(size):
            sides = side_of(hits[struck[a], at.D_MODE]) * side_of(hits[struck[b], at.D_MODE])
            matrix[a, b] = sides * (d.shapes[struck[b]] @ moved)
        matrix[a, a] += 1.0 / d.table[struck[a], at.GRAIN_MASS]
    if size == 1:  # as nearly always: what follows takes much longer
        impulse[0] = wanted[0] / matrix[0, 0]
        return impulse
    kept = np.arange(size)
    while len(kept) > 0:
        found = np.linalg.solve(matrix[kept][:, kept], wanted[kept])
        if pulling or found.min() >= 0.0:
            impulse[kept] = found
            break
        kept = np.delete(kept, found.argmin())
    return impulse


@kernel
def _strike(d, inverse, segment, y, states, grains, hits, struck, wanted, pulling):
    """Enter the impulses of `_impulses` and what they lose."""
    before = np.empty(len(struck))
    for a, hit in enumerate(struck):
        before[a] = _closing(d, segment, states, grains, hits, hit)[0]
    impulse = _impulses(d, inverse, hits, struck, wanted, pulling)
    for a, hit in enumerate(struck):
        push = side_of(hits[hit, at.D_MODE]) * impulse[a]
        moved = inverse @ d.shapes[hit]
        for i in range(states.shape[0]):
            states[i, at.Q_RATE] -= push * moved[i]
        grains[hit, at.G_SPEED] += push / d.table[hit, at.GRAIN_MASS]
    for a, hit in enumerate(struck):
        after = _closing(d, segment, states, grains, hits, hit)[0]
        y[at.CONTACT_LOSS] += 0.5 * impulse[a] * (before[a] + after)
        if hit == 0 and hits[hit, at.D_MODE] == at.ON_CEILING:
            y[at.CEILING_WORK] -= segment[at.CEILING_VELOCITY] * impulse[a]


@kernel
def _keep_at_rest(d, inverse, wall, segment, y, states, grains, hits, left_out, fastest):
    """Hold the pressed grains that another's impact has moved off so slowly that they would be back in no time.

    left_out (dampers,): those that are clamped or were thrown off. Two that do this to each other would never rest.
    """
    slowly = np.zeros(len(hits), np.bool_)
    for j in range(len(hits)):
        if hits[j, at.D_MODE] != at.FREE and not left_out[j]:
            parting = -_closing(d, segment, states, grains, hits, j)[0]
            push = side_of(hits[j, at.D_MODE]) * (wall[j, 2] + d.gravity)
            slowly[j] = 2.0 * parting * fastest <= STICKING * push
    kept = np.flatnonzero(slowly)
    if len(kept) > 1:
        wanted = np.empty(len(kept))
        for a, hit in enumerate(kept):
            wanted[a] = _closing(d, segment, states, grains, hits, hit)[0]
        _strike(d, inverse, segment, y, states, grains, hits, kept, wanted, True)


@kernel
def _bounces(d, wall, segment, tau, hits, j, closing, reduced, fastest, replaced):
    """Restitution of an impact [-]; 0 where the bounces after it would be over in no time, or have no room."""
    e = restitution(d.law, closing, reduced, d.parameters[j])
    push = side_of(hits[j, at.D_MODE]) * (wall[j, 2] + d.gravity)
    slow = max(push, 0.0) * max(NO_SPEED, STICKING * (1.0 - e) / max(2.0 * e, 1e-300))
    sticks = replaced or clamps(d, segment, tau, j) or (push >= 0.0 and closing * fastest <= slow)
    return 0.0 if sticks else e


@kernel
def _only_low(d, wall, segment, tau, hits, j, closing, fastest):
    """Count a flight too low to matter before an impact; returns whether nearly all were (`micro_bounce`)."""
    size = abs(wall[j, 0]) + abs(wall[j, 1]) / fastest
    push = side_of(hits[j, at.D_MODE]) * (wall[j, 2] + d.gravity)
    low = clearance_of(d, segment, tau, j)[0] <= LOW * size
    low = low or (push > 0.0 and closing * closing <= 2.0 * push * LOW * size)
    hits[j, at.D_LOW_HOPS] = hits[j, at.D_LOW_HOPS] + 1 if low else max(0, hits[j, at.D_LOW_HOPS] - OUTWEIGHED)
    return low and hits[j, at.D_LOW_HOPS] > LIMIT and push > 0.0


@kernel
def _count(n, hits, j, closing, now, observing, impacts):
    """Count an impact, and log its time, wall, closing speed and damper."""
    floor = hits[j, at.D_MODE] == at.ON_FLOOR
    hits[j, at.D_FLOOR if floor else at.D_CEILING] += 1
    n[at.FLOOR_HITS if floor else at.CEILING_HITS] += 1
    if observing:
        hits[j, at.D_WINDOW_FLOOR if floor else at.D_WINDOW_CEILING] += 1
        n[at.WINDOW_FLOOR if floor else at.WINDOW_CEILING] += 1
    if n[at.IMPACTS] < impacts.shape[0]:
        row = impacts[n[at.IMPACTS]]
        row[at.E_TIME], row[at.E_WALL], row[at.E_SPEED] = now, side_of(hits[j, at.D_MODE]), closing
        if len(row) > at.IMPACT_COLUMNS:
            row[at.IMPACT_COLUMNS] = j + 1
        n[at.IMPACTS] += 1


@kernel
def meet(d, wall, segment, tau, which, y, n, states, grains, hits, clamped, fastest, stuck, view, impacts):
    """Exchange momentum at the walls that are touched at local time tau, of the damper `which` at least.

    wall (dampers, 3): motion of the containers before; stuck: impacts at this very instant so far. Grains that do not
    part from their walls rest on them from then on. Returns whether a contact is deeper than its grain's radius.
    """
    landed = _land(d, wall, segment, tau, which, grains, hits)
    inverse = np.empty((states.shape[0], states.shape[0]))
    inverse_mass(d.modes, d.table, d.shapes, clamped, inverse)
    closing, counted, thrown = np.zeros(len(hits)), np.zeros(len(hits), np.bool_), np.zeros(len(hits), np.bool_)
    for lap in range(_ROUNDS):
        for j in range(len(hits)):
            closing[j] = 0.0
            if hits[j, at.D_MODE] != at.FREE and not clamped[j]:
                speed, size, _wall = _closing(d, segment, states, grains, hits, j)
                closing[j] = speed if speed > _NONE * size else 0.0
                if landed[j] and lap == 0 and not closing[j] > 0.0:  # touched without speed
                    _count(n, hits, j, 0.0, view.origin + tau, view.observing, impacts)
        fastest_closing = closing.max()
        if fastest_closing <= 0.0:
            break
        struck = np.flatnonzero(closing >= (1.0 - _ALIKE) * fastest_closing)
        least = 1.0
        for hit in struck:
            reduced = 1.0 / (1.0 / d.table[hit, at.GRAIN_MASS] + d.shapes[hit] @ (inverse @ d.shapes[hit]))
            replaced = (
                landed[hit] and not counted[hit] and _only_low(d, wall, segment, tau, hits, hit, closing[hit], fastest)
            )
            replaced = replaced or lap + stuck > COLLAPSE
            e = _bounces(d, wall, segment, tau, hits, hit, closing[hit], reduced, fastest, replaced)
            least = min(least, e)
            if closing[hit] > d.table[hit, at.FAST]:
                return True
            thrown[hit] |= e > 0.0
            if not counted[hit] and (landed[hit] or e > 0.0):
                counted[hit] = True
                _count(n, hits, hit, closing[hit], view.origin + tau, view.observing, impacts)
        _strike(d, inverse, segment, y, states, grains, hits, struck, (1.0 + least) * closing[struck], False)
    _keep_at_rest(d, inverse, wall, segment, y, states, grains, hits, clamped | thrown, fastest)
    for j in range(len(hits)):
        if hits[j, at.D_MODE] != at.FREE:
            speed, size, moving_wall = _closing(d, segment, states, grains, hits, j)
            if clamped[j] or speed >= -_NONE * size:
                grains[j, at.G_SPEED] = moving_wall
            else:
                hits[j, at.D_MODE] = at.FREE
    y[at.BEAM_VELOCITY] = 0.0
    for i in range(states.shape[0]):
        y[at.BEAM_VELOCITY] += d.shapes[0, i] * states[i, at.Q_RATE]
    return False
