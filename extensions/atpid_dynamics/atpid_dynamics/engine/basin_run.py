# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many states of one system followed under a harmonic drive until each lies in a known neighbourhood of a motion."""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.row_loop import integrate
from atpid_sim.kernel import kernel

#: What `follow_starts` enters of a state: not in any neighbourhood, and a run that did not reach its end.
NOWHERE, FAILED = -1, -2
#: Where a neighbourhood has whether the grain touches a wall.
_TOUCHING = -1


def neighbourhood_size(count: int) -> int:
    """Numbers of a neighbourhood, float64: section state (count,), metric (count, count), whether a wall is touched."""
    return count * (count + 1) + 1


@kernel
def _inside(sections, y, n, place):
    """Whether a state lies in a neighbourhood: distance squared by its metric at most 1."""
    if (n[at.MODE] == at.FREE) == (place[_TOUCHING] != 0.0):
        return False
    count, squared = sections.places.size, 0.0
    for i in range(count):
        for k in range(count):
            off, other = y[sections.places[i]] - place[i], y[sections.places[k]] - place[k]
            squared += off * place[count + count * i + k] * other
    return squared <= 1.0


@kernel
def follow_starts(run, sections, rows, places, y, n, most, budget, where, when):
    """Follow states y (runs, m), n (runs, COUNTERS), changed in place, for `most` periods at most.

    run: as `integrate` takes it; sections: how section states lie in
    y; rows (k, DRIVE_COLUMNS): a period from time zero on, where each state has its own time; at the end of row j,
    which may have no length, lies the neighbourhood places[j] (`neighbourhood_size`); a NaN in its metric: none. where
    (runs,) gets the number of the first neighbourhood that a state lies in, NOWHERE or FAILED; when (runs,) how many
    periods after its begin. Returns the steps of all together; budget: of each row.
    """
    nothing, unsampled, never = np.zeros((0, at.IMPACT_COLUMNS)), np.zeros((at.SAMPLE_ROWS, 0)), (math.inf, math.inf)
    period, steps = rows[-1, at.END], 0
    for k in range(y.shape[0]):
        state, counts, begin = y[k], n[k], y[k, at.TIME]
        where[k], when[k] = NOWHERE, math.inf
        for passed in range(most):
            for j in range(rows.shape[0]):
                if rows[j, at.END] < state[at.TIME]:
                    continue
                counts[at.CONTACT_STEPS], counts[at.FLIGHT_STEPS], counts[at.REJECTED] = 0, 0, 0
                row = rows[j : j + 1]
                outcome = integrate(run, row, state, counts, never, (0.0, 1.0), unsampled, nothing, budget)
                steps += counts[at.CONTACT_STEPS] + counts[at.FLIGHT_STEPS] + counts[at.REJECTED]
                if outcome != 0:
                    where[k] = FAILED
                elif _inside(sections, state, counts, places[j]):
                    where[k], when[k] = j, passed + (rows[j, at.END] - begin) / period
                if where[k] != NOWHERE:
                    break
            if where[k] != NOWHERE:
                break
            state[at.TIME] = 0.0
    return steps
