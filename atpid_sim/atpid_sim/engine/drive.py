# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The drive table: the motion of support and ceiling, as rows between whose ends nothing has a kink.

A row (DRIVE_COLUMNS,) is laid out in `columns.py`. Support: see `beam.py`; ceiling: height + velocity * tau.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import support_at
from atpid_sim.outcome import NumericalFailure
from atpid_sim.system import Array

#: No row is longer than this many periods, so that local times, and so phases, keep their digits.
_PERIODS_PER_ROW = 500.0

Points = Sequence[tuple[float, float]]


def harmonic_rows(amplitude: Points, frequency: float, duration: float) -> Array:
    """Rows (n, columns) of u = A(t) sin(2 pi f t), A [m] along straight ramps between the points (t [s], A [m])."""
    omega = 2.0 * math.pi * frequency
    times, values = zip(*amplitude, strict=True)
    edges = _split(sorted({0.0, duration, *(t for t in times if 0.0 < t < duration)}), _PERIODS_PER_ROW / frequency)
    table = np.zeros((len(edges) - 1, at.DRIVE_COLUMNS))
    table[:, at.START], table[:, at.END] = edges[:-1], edges[1:]
    first, last = np.interp(edges[:-1], times, values), np.interp(edges[1:], times, values)
    table[:, at.A0], table[:, at.A1] = first, (last - first) / np.diff(edges)
    table[:, at.OMEGA] = omega
    # the fractional period is taken before the multiplication by 2 pi: late rows keep an exact phase
    table[:, at.PHASE] = 2.0 * math.pi * np.mod(np.asarray(edges[:-1]) * frequency, 1.0)
    return table


def spline_rows(times: Array, coefficients: Array, duration: float) -> Array:
    """Rows (n, columns) of a cubic spline: knots (n+1,) [s] and coefficients (4, n), highest power first [m/s^k]."""
    table = np.zeros((len(times) - 1, at.DRIVE_COLUMNS))
    table[:, at.START], table[:, at.END] = times[:-1], times[1:]
    for power in range(4):
        table[:, at.C0 + power] = coefficients[3 - power]
    return table[table[:, at.START] < duration]


def still_rows(duration: float) -> Array:
    """Support rows (1, DRIVE_COLUMNS) of a support that does not move."""
    table = np.zeros((1, at.DRIVE_COLUMNS))
    table[0, at.END] = duration
    return table


def with_ceiling(rows: Array, heights: Points) -> Array:
    """Cut support rows at the ceiling's kinks and fill in its motion: heights (t [s], h [m]), straight in between."""
    table = cut(rows, [t for t, _ in heights if rows[0, at.START] < t < rows[-1, at.END]])
    enter_ceiling(table, heights)
    return table


def enter_ceiling(table: Array, heights: Points) -> None:
    """Fill in the ceiling's motion where no row has a kink of it inside: heights (t [s], h [m])."""
    times, values = zip(*heights, strict=True)
    table[:, at.HEIGHT] = np.interp(table[:, at.START], times, values)
    risen = np.interp(table[:, at.END], times, values) - table[:, at.HEIGHT]
    table[:, at.CEILING_VELOCITY] = risen / (table[:, at.END] - table[:, at.START])


def between(rows: Array, begin: float, end: float) -> Array:
    """Return the rows of the same motion that cover [begin, end] [s], cut at both."""
    kept = rows[(rows[:, at.END] > begin) & (rows[:, at.START] < end)]
    if not len(kept):
        raise NumericalFailure(f"the scene's drive ends at {rows[-1, at.END]:g} s, before {end:g} s")
    cut_rows = cut(kept, [t for t in (begin, end) if kept[0, at.START] < t < kept[-1, at.END]])
    return cut_rows[(cut_rows[:, at.START] >= begin) & (cut_rows[:, at.END] <= end)]


def support_displacement(rows: Array, t: float) -> float:
    """Return the displacement of the support at time t [s] in m."""
    row = row_at(rows, t)
    return float(support_at(row, t - row[at.START])[0])


def ceiling_height(rows: Array, t: float) -> float:
    """Return the height of the ceiling above the floor at time t [s] in m."""
    return height_in(row_at(rows, t), t)


def height_in(row: Array, t: float) -> float:
    """Return the height of the ceiling above the floor at time t [s] of a row in m."""
    return float(row[at.HEIGHT] + row[at.CEILING_VELOCITY] * (t - row[at.START]))


def row_at(rows: Array, t: float) -> Array:
    """Return the row in which time t [s] lies; the first or the last for a time outside the table."""
    row: Array = rows[min(max(int(np.searchsorted(rows[:, at.START], t, side="right")) - 1, 0), len(rows) - 1)]
    return row


def _split(edges: list[float], longest: float) -> list[float]:
    fine = [edges[0]]
    for left, right in pairwise(edges):
        pieces = max(1, math.ceil((right - left) / longest))
        if pieces > 10_000_000:
            raise NumericalFailure(f"a run of {right - left:g} s has more than {pieces * _PERIODS_PER_ROW:g} periods")
        fine.extend(left + (right - left) * k / pieces for k in range(1, pieces))
        fine.append(right)
    return fine


def cut(rows: Array, kinks: Sequence[float]) -> Array:
    """Return the same support motion with row ends at the kinks as well."""
    if not kinks:  # as in most blocks of a plant, whose rows have been cut already
        return rows.copy()
    edges = np.unique(np.concatenate([rows[:, at.START], rows[-1:, at.END], np.asarray(kinks, dtype=float)]))
    source = np.searchsorted(rows[:, at.START], edges[:-1], side="right") - 1
    pieces = rows[source].copy()
    shift = edges[:-1] - pieces[:, at.START]
    pieces[:, at.START], pieces[:, at.END] = edges[:-1], edges[1:]
    pieces[:, at.PHASE] = np.mod(pieces[:, at.PHASE] + pieces[:, at.OMEGA] * shift, 2.0 * math.pi)
    pieces[:, at.A0] += pieces[:, at.A1] * shift
    c0, c1, c2, c3 = (pieces[:, at.C0 + k].copy() for k in range(4))
    pieces[:, at.C0] = c0 + shift * (c1 + shift * (c2 + shift * c3))
    pieces[:, at.C1] = c1 + shift * (2.0 * c2 + 3.0 * shift * c3)
    pieces[:, at.C2] = c2 + 3.0 * shift * c3
    return pieces
