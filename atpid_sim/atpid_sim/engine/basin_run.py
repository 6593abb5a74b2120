# SPDX-License-Identifier: Apache-2.0
"""Many states of one system followed under a harmonic drive until each lies in a known neighbourhood of a motion."""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.row_loop import integrate
from atpid_sim.kernel import kernel

#: What `follow_starts` enters of a state: not in any neighbourhood, and a run that did not reach its end.
NOWHERE, FAILED = -1, -2
#: A neighbourhood, float64 (NEIGHBOURHOOD,): a section state (4,), metric (4, 4), and whether the grain touches a wall.
METRIC, TOUCHING, NEIGHBOURHOOD = 4, 20, 21


@kernel
def _inside(y, n, place):
    """Whether a state lies in a neighbourhood (NEIGHBOURHOOD,): distance squared by its metric at most 1."""
    if (n[at.MODE] == at.FREE) == (place[TOUCHING] != 0.0):
        return False
    off = (
        y[at.BEAM] - place[0], y[at.BEAM_VELOCITY] - place[1], y[at.GRAIN] - place[2], y[at.GRAIN_VELOCITY] - place[3]
    )  # fmt: skip
    squared = 0.0
    for i in range(4):
        for k in range(4):
            squared += off[i] * place[METRIC + 4 * i + k] * off[k]
    return squared <= 1.0


@kernel
def follow_starts(run, rows, places, y, n, most, budget, where, when):
    """Follow states y (runs, STATE_SIZE), n (runs, COUNTERS), changed in place, for `most` periods at most.

    run: (fidelity, system, mass, law, parameters, rtol, contacts) of `integrate`; rows (k, DRIVE_COLUMNS): a period
    from time zero on, where each state has its own time; at the end of row j, which may have no length, lies the
    neighbourhood places[j] (NEIGHBOURHOOD,); a NaN in its metric: none. where (runs,) gets the number of the first
    neighbourhood that a state lies in, NOWHERE or FAILED; when (runs,) how many periods after its begin. Returns the
    steps of all together; budget: of each row.
    """
    fidelity, system, mass, law, p, rtol, contacts = run
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
                outcome = integrate(
                    fidelity, rows[j : j + 1], system, mass, law, p, rtol, state, counts, never, (0.0, 1.0), unsampled,
                    nothing, budget, contacts,
                )  # fmt: skip
                steps += counts[at.CONTACT_STEPS] + counts[at.FLIGHT_STEPS] + counts[at.REJECTED]
                if outcome != 0:
                    where[k] = FAILED
                elif _inside(state, counts, places[j]):
                    where[k], when[k] = j, passed + (rows[j, at.END] - begin) / period
                if where[k] != NOWHERE:
                    break
            if where[k] != NOWHERE:
                break
            state[at.TIME] = 0.0
    return steps
