# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of contacts, made once for each law, its parameters and the reduced mass, in milliseconds.

Each contact of a table is integrated (`engine/scaled_contact.py`) at Chebyshev's points in zeta; the polynomial
through them is entered at even spacing, which is read quickly. Laws whose damping depends on the speed get a row for
each of many speeds; that the others need one only is found, not asked of the law.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from atpid_sim.contact import dispatch
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import contact_table as table
from atpid_sim.engine import scaled_contact as scaled
from atpid_sim.engine.contact_table import NO_TABLE, ContactTable
from atpid_sim.kernel_inputs import Contact
from atpid_sim.root import root
from atpid_sim.system import Array, System, reduced_mass

#: Least and largest alpha; beyond, the beam carries the grain along or draws the wall away, and it is integrated.
_LOWEST, _HIGHEST = -1.0, 1.0
#: Chebyshev's points and even ones, in zeta.
_NODES, _POINTS = 16, 65
#: Speeds [m/s] between which a law is tabulated whose damping depends on the speed, and in how many rows.
_SLOWEST, _FASTEST, _ROWS = 2e-3, 50.0, 20
#: Results that differ by less between speeds are the same.
_SAME = 1e-7
#: Tolerance of the contacts integrated, and how long one may take, in T.
_RTOL, _LONGEST = 1e-10, 30.0
#: Halvings in the search for alpha_c.
_HALVINGS = 24
#: Width of the differences for derivatives: at most, and as a share of the distance from alpha_c.
_WIDTH, _SHARE = 1e-2, 0.05
#: Logarithms of the least and largest depth [m] considered.
_SHALLOW, _DEEP = -60.0, 10.0


class _Scaled(NamedTuple):
    """A law and a reduced mass at one speed: contacts in their own units."""

    contact: Contact
    mass: float  # reduced [kg]
    speed: float  # [m/s]
    time: float  # T at this speed [s]

    def solve(self, alpha: float, drive: Array) -> Array | None:
        """Return the results (RESULTS,) under alpha and what else drives it (DRIVES,); None where it does not end."""
        acceleration, time = self.speed / self.time, self.time
        units = np.array([acceleration, acceleration / time, acceleration / time**2, 1.0 / time, 1.0 / time**2])
        given, found = drive.copy(), np.zeros(scaled.RESULTS)
        given[scaled.ACCELERATION] += alpha
        law, parameters = self.contact
        ended = scaled.solve_contact(
            law, parameters, self.mass, self.speed, given * units, time, _LONGEST * time, _RTOL, found
        )
        length = self.speed * time
        return found / np.array([time, length, self.speed, length * time, length * time, length]) if ended else None


def table_of(system: System, contact: Contact) -> tuple[ContactTable, float]:
    """Return the table of contacts of a system, and the error of its interpolation; see `contact_table`."""
    return contact_table(contact.law, tuple(contact.parameters.tolist()), reduced_mass(system))


@lru_cache(maxsize=256)
def contact_table(law: int, parameters: tuple[float, ...], mass: float) -> tuple[ContactTable, float]:
    """Return the table of a law, its parameters (6,) and a reduced mass [kg], and the error of its interpolation.

    The error is that of the separation speed over the approach speed, the largest found between the points. A law whose
    grain does not leave the wall even without load gets a table without contacts.
    """
    contact = Contact(law, np.array(parameters))
    if law == IMPACT:
        return NO_TABLE, 0.0
    slow, fast = (_time(contact, mass, speed) for speed in (1.0, math.e))
    if not (0.0 < slow < math.inf and 0.0 < fast < math.inf):
        return NO_TABLE, 0.0
    exponent = -math.log(fast / slow)

    def at(speed: float) -> _Scaled:
        return _Scaled(contact, mass, speed, slow * speed**-exponent)

    ends = [at(speed).solve(0.0, np.zeros(scaled.DRIVES)) for speed in (_SLOWEST, 1.0, _FASTEST)]
    alone = all(end is not None and ends[1] is not None and np.allclose(end, ends[1], _SAME, _SAME) for end in ends)
    speeds = np.array([1.0]) if alone else np.geomspace(_SLOWEST, _FASTEST, _ROWS)
    rows = [_row(at(float(speed))) for speed in speeds]
    if any(row is None for row in rows):
        return NO_TABLE, 0.0
    heads, values, errors = zip(*[row for row in rows if row is not None], strict=True)
    spacing = 0.0 if alone else math.log(speeds[1] / speeds[0])
    made = ContactTable(slow, exponent, _LOWEST, math.log(speeds[0]), spacing, np.array(heads), np.array(values))
    between = () if alone else np.sqrt(speeds[:-1] * speeds[1:])
    return made, max([*errors, *(_error_between_rows(made, at(float(speed))) for speed in between)])


def _error_between_rows(made: ContactTable, one: _Scaled) -> float:
    """Return the error of the separation speed without load, relative to the approach speed."""
    exact, found = one.solve(0.0, np.zeros(scaled.DRIVES)), np.zeros(table.COLUMNS)
    if exact is None or not table.read(made, one.speed, 0.0, 0.0, 0.0, 0.0, 0.0, found):
        return 0.0
    return abs(float(found[scaled.VELOCITY] / one.speed - exact[scaled.VELOCITY]))


def _time(contact: Contact, mass: float, speed: float) -> float:
    """Return the deepest overlap without damping or load over the speed [s]; NaN where the law stores no energy."""
    kinetic = 0.5 * mass * speed * speed

    def excess(log_depth: float) -> float:
        depth = math.exp(log_depth)
        return math.log(max(float(dispatch.energy(contact.law, depth, depth, contact.parameters)), 1e-300) / kinetic)

    if not excess(_SHALLOW) < 0.0 < excess(_DEEP):
        return math.nan
    return math.exp(root(excess, _SHALLOW, _DEEP, xtol=1e-13)) / speed


def _row(one: _Scaled) -> tuple[Array, Array, float] | None:
    """Return head (HEAD,), values (points, COLUMNS) and their error at one speed; None where no contact ends."""
    free = one.solve(0.0, np.zeros(scaled.DRIVES))
    if free is None:
        return None
    head = np.zeros(table.HEAD)
    duration = free[scaled.DURATION]
    head[table.FREE_DURATION], head[table.FREE_IMPULSE] = duration, 1.0 - free[scaled.VELOCITY]
    head[table.FREE_SHIFT] = duration - free[scaled.OVERLAP]
    head[table.CRITICAL] = critical = _critical(one)

    def zeta_of(node: Array) -> Array:
        return table.NEAREST + (1.0 - table.NEAREST) * 0.5 * (1.0 + node)

    def alpha_of(node: float) -> float:
        return float(critical - zeta_of(np.array(node)) ** 2 * (critical - _LOWEST))

    nodes = chebyshev.chebpts1(_NODES)
    columns = [_columns(one, head, alpha_of(node)) for node in nodes]
    if any(each is None for each in columns):
        return None
    series = chebyshev.chebfit(nodes, np.array(columns), _NODES - 1)
    values: Array = np.asarray(chebyshev.chebval(np.linspace(-1.0, 1.0, _POINTS), series).T, dtype=np.float64)
    between = np.array([0.5 * (a + b) for a, b in pairwise(nodes)])
    exact = [one.solve(alpha_of(node), np.zeros(scaled.DRIVES)) for node in between]
    found = chebyshev.chebval(between, series).T
    error = max(
        abs(f[scaled.VELOCITY] - e[scaled.VELOCITY]) for f, e in zip(found, exact, strict=True) if e is not None
    )
    return head, values, float(error)


def _critical(one: _Scaled) -> float:
    """Return the alpha from which on the force does not vanish, or the largest tabulated."""
    low, high, none = 0.0, _HIGHEST, np.zeros(scaled.DRIVES)
    if one.solve(high, none) is not None:
        return high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if one.solve(middle, none) is not None else (low, middle)
    return low


def _columns(one: _Scaled, head: Array, alpha: float) -> Array | None:
    """Return a contact (COLUMNS,): its results and their derivatives by what varies; None where one does not end."""
    results = one.solve(alpha, np.zeros(scaled.DRIVES))
    if results is None:
        return None
    # what varies is taken against its value at the instant of detachment without load, which is part of alpha
    duration = head[table.FREE_DURATION]
    offsets = (duration, 0.5 * duration**2, head[table.FREE_IMPULSE], head[table.FREE_SHIFT])
    width = min(_WIDTH, _SHARE * (head[table.CRITICAL] - alpha))
    slopes = []
    for place, offset in zip(table.VARIATIONS, offsets, strict=True):
        ends = []
        for sign in (1.0, -1.0):
            drive = np.zeros(scaled.DRIVES)
            drive[place], drive[scaled.ACCELERATION] = sign * width, -sign * width * offset
            ends.append(one.solve(alpha, drive))
        if ends[0] is None or ends[1] is None:
            return None
        slopes.append((ends[0] - ends[1])[: table.VARIED] / (2.0 * width))
    return np.concatenate([results, *slopes])
