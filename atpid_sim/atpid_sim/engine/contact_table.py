# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of contacts, and how one is read.

Times in T = time * speed^-exponent and lengths in speed * T leave of a contact one number, alpha = b T / speed, b the
relative acceleration of wall and grain, and where the law's damping depends on the speed that as well. What else acts
is small and enters by first derivatives: the change of b in time, and the beam's answer to its recoil. b is taken at
the instant at which the force vanishes without load, so that little is left to these.

Towards alpha_c, from which on the grain stays in contact, results vary as the root of the distance: the table is
evenly spaced in zeta = sqrt((alpha_c - alpha) / (alpha_c - lowest)).
"""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.engine.scaled_contact import (
    CURVATURE,
    DEEPEST,
    DURATION,
    MEAN,
    OVERLAP,
    RATE,
    RECOIL_DAMPER,
    RECOIL_SPRING,
    RESULTS,
    THIRD,
    VELOCITY,
)
from atpid_sim.kernel import kernel, lean
from atpid_sim.system import Array

#: What of a contact is tabulated with its derivatives by what drives it (the first of `RESULTS`), and by what.
VARIED = 3
VARIATIONS = (RATE, CURVATURE, RECOIL_DAMPER, RECOIL_SPRING)
COLUMNS = RESULTS + VARIED * len(VARIATIONS)
#: Places of a row's head: critical alpha; duration, impulse and its integral of the contact without load.
CRITICAL, FREE_DURATION, FREE_IMPULSE, FREE_SHIFT, HEAD = range(5)
#: Least zeta, and so the nearest to alpha_c, at which contacts are taken from the table.
NEAREST = 0.05


class ContactTable(NamedTuple):
    """Contacts of one law, its parameters and one reduced mass; without rows: none can be taken from it."""

    time: float  # T at 1 m/s [s]
    exponent: float
    lowest: float  # alpha
    slowest: float  # logarithm of the speed of the first row
    spacing: float  # of the rows in that logarithm; 0: one row for all speeds
    heads: Array  # (rows, HEAD)
    values: Array  # (rows, points, COLUMNS), points from zeta = NEAREST to 1


NO_TABLE = ContactTable(1.0, 0.0, 0.0, 0.0, 0.0, np.zeros((0, HEAD)), np.zeros((0, 2, COLUMNS)))


@kernel
def _weights(place):
    """Lagrange's weights of four even nodes 0, 1, 2, 3 at `place`."""
    a, b, c = place - 1.0, place - 2.0, place - 3.0
    return -a * b * c / 6.0, 0.5 * place * b * c, -0.5 * place * a * c, place * a * b / 6.0


@lean
def _head(table, place, first, weights):
    """One number of the heads between the rows; with a literal `place` it would be compiled for each."""
    if table.values.shape[0] == 1:
        return table.heads[0, place]
    total = 0.0
    for row in range(4):
        total += weights[row] * table.heads[first + row, place]
    return total


@lean
def read(table, speed, b, rate, curvature, chi, eta, found):
    """Write a contact that begins at `speed` [m/s] into found (COLUMNS,), SI, the first `RESULTS` of it valid.

    b, rate, curvature: relative acceleration [m/s^2] and its derivatives at the touch; chi [1/s], eta [1/s^2]: see
    `scaled_contact`. Returns whether the table has such a contact.
    """
    rows, points = table.values.shape[0], table.values.shape[1]
    if rows == 0 or not speed > 0.0:
        return False
    logarithm = math.log(speed)
    time = table.time * math.exp(-table.exponent * logarithm)
    first, weights = 0, (1.0, 0.0, 0.0, 0.0)
    if rows > 1:
        place = (logarithm - table.slowest) / table.spacing
        if not 0.0 <= place <= rows - 1.0:
            return False
        first = min(max(int(place) - 1, 0), rows - 4)
        weights = _weights(place - first)
    critical = _head(table, np.int64(CRITICAL), first, weights)
    duration = _head(table, np.int64(FREE_DURATION), first, weights)
    by_rate, by_curvature = rate * time * time / speed, curvature * time * time * time / speed
    by_damper, by_spring = chi * time, eta * time * time
    alpha = b * time / speed + duration * (by_rate + 0.5 * duration * by_curvature)
    alpha += by_damper * _head(table, np.int64(FREE_IMPULSE), first, weights)
    alpha += by_spring * _head(table, np.int64(FREE_SHIFT), first, weights)
    if not table.lowest <= alpha < critical:
        return False
    zeta = math.sqrt((critical - alpha) / (critical - table.lowest))
    if zeta < NEAREST:
        return False
    place = (zeta - NEAREST) / (1.0 - NEAREST) * (points - 1)
    left = min(max(int(place) - 1, 0), points - 4)
    u0, u1, u2, u3 = _weights(place - left)
    values = table.values
    for column in range(COLUMNS):
        found[column] = 0.0
    for row in range(1 if rows == 1 else 4):
        w, at = weights[row], first + row
        for column in range(COLUMNS):
            one = u0 * values[at, left, column] + u1 * values[at, left + 1, column]
            found[column] += w * (one + u2 * values[at, left + 2, column] + u3 * values[at, left + 3, column])
    for k in range(VARIED):
        at = RESULTS + k
        varied = by_rate * found[at] + by_curvature * found[at + VARIED]
        found[k] += varied + by_damper * found[at + 2 * VARIED] + by_spring * found[at + 3 * VARIED]
    length = speed * time
    found[DURATION] *= time
    found[OVERLAP] *= length
    found[VELOCITY] *= speed
    found[THIRD] *= length * time
    found[MEAN] *= length * time
    found[DEEPEST] *= length
    return True
