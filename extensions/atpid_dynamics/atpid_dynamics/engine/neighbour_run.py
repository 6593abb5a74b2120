# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions at heights side by side, in one kernel: each is solved for from those before it.

Newton's method takes the derivative of a neighbour for as long as its steps shrink fast, so that where motions change
smoothly one passage is enough: the one that verifies the motion and has its amplitude.
"""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.row_loop import IN_CONTACT, integrate
from atpid_sim.engine.sections import enter_section, leave_section
from atpid_sim.kernel import kernel

#: How many heights may take the same derivative, and width of its differences relative to the motion's size.
_SHARED, _WIDTH = 32, 1e-4
#: Newton's steps at most; how far one may lead, relative to the motion's size; by which factor at least each has to be
#: shorter than the one before, else the derivative is taken anew.
_STEPS, _FAR, _SHORTER = 8, 0.2, 0.2
#: How far from the first motion its derivative may have been taken, relative: the multipliers come of it.
_NEAR = 1e-3
#: Motions from which the next is extrapolated.
_KNOWN = 4


@kernel
def _pass(run, table, places, section, y, n, budget, after):
    """Map a section state (d,) through the table; `after` (d,) and y get the end. Returns an outcome, or IN_CONTACT."""
    nothing, unsampled = np.zeros((0, at.IMPACT_COLUMNS)), np.zeros((at.SAMPLE_ROWS, 0))
    y[:], n[:] = places.flight, 0
    n[at.MODE] = at.FREE
    enter_section(run[1].modes, places, section, y)
    outcome = integrate(run, table, y, n, (0.0, table[0, at.END]), (0.0, 1.0), unsampled, nothing, budget)
    leave_section(places, y, after)
    return IN_CONTACT if outcome == 0 and n[at.MODE] != at.FREE else outcome


@kernel
def _differences(run, table, places, section, scale, y, n, budget, slope):
    """Derivative (d, d) of the map at a section state (d,), by central differences; returns whether there is one."""
    after = np.empty(section.size)
    for i in range(section.size):
        for sign in (0.5, -0.5):
            moved = section.copy()
            moved[i] += sign * _WIDTH * scale[i]
            if _pass(run, table, places, moved, y, n, budget, after) != 0:
                return False
            slope[:, i] = after if sign > 0.0 else (slope[:, i] - after) / (_WIDTH * scale[i])
    return np.isfinite(slope).all()


@kernel
def _extrapolated(heights, sections, k):
    """Section state (d,) at height k on the polynomial through those of the heights before it."""
    guess = np.zeros(sections.shape[1])
    for i in range(max(0, k - _KNOWN), k):
        weight = 1.0
        for j in range(max(0, k - _KNOWN), k):
            if j != i:
                weight *= (heights[k] - heights[j]) / (heights[i] - heights[j])
        guess += weight * sections[i]
    return guess


@kernel
def solve_along(run, table, places, heights, first, scale, close, budget, sections, solved):
    """Solve for the periodic motions at rising or falling heights (k,) [m], from a section state near the first (d,).

    run: as `integrate` takes it; table (1, DRIVE_COLUMNS): from one
    passage of the section to the next, from time zero on; places: `sections.Sections`, of a state that keeps no ledger
    if that is so; scale (d,): size of the motion; close: length of the last step, relative. Into
    sections (k, d) go the motions, into solved (3, k) amplitude [m], length of the last step, largest modulus of the
    multipliers at the last derivative. Returns how many were found before one that was not.
    """
    size, y, n = first.size, places.flight.copy(), np.zeros(at.COUNTERS, dtype=np.int64)
    after, slope, inverse, derived = np.empty(size), np.empty((size, size)), np.empty((size, size)), np.empty(size)
    largest, age = math.inf, _SHARED
    for k in range(heights.size):
        table[0, at.HEIGHT] = heights[k]
        section = first.copy() if k == 0 else _extrapolated(heights, sections, k)
        before, taken, amplitude = math.inf, math.inf, 0.0
        for _ in range(_STEPS):
            if _pass(run, table, places, section, y, n, budget, after) != 0:
                return k
            amplitude = 0.5 * (y[at.HIGHEST] - y[at.LOWEST])
            if age < _SHARED:
                taken = np.abs(np.dot(inverse, after - section) / scale).max()
            # with a neighbour's derivative only for as long as that leads there fast, and for the first one not at all
            far = k == 0 and age < _SHARED and np.abs((section - derived) / scale).max() > _NEAR
            slow = age > 0 and taken > max(close, _SHORTER * before)
            if age >= _SHARED or slow or (far and taken <= close):
                if not _differences(run, table, places, section, scale, y, n, budget, slope):
                    return k
                derived[:], age = section, 0
                largest = np.abs(np.linalg.eigvals(slope.astype(np.complex128))).max()
                inverse[:] = np.linalg.inv(np.eye(size) - slope)
            step = np.dot(inverse, after - section)
            taken = np.abs(step / scale).max()
            if not taken <= _FAR:
                return k
            section = section + step
            if taken <= close:
                break
            before = taken
        if taken > close:
            return k
        sections[k] = section
        solved[0, k], solved[1, k], solved[2, k] = amplitude, taken, largest
        age += 1
    return heights.size
