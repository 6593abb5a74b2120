# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""States of a structure with several dampers: the further grains at the start, and displaced."""

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.meeting import Dampers
from atpid_sim.engine.state import State


def with_further_grains(state: State, dampers: Dampers, apart: float) -> State:
    """Return a state of modes and one grain with the others on their floors; apart: as in `displace` [m]."""
    parts = state.y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    grains = np.zeros((len(dampers.shapes), at.GRAIN_COLUMNS))
    hits = np.zeros((len(dampers.shapes), at.DAMPER_COUNTERS), dtype=np.int64)
    grains[:, [at.G_PLACE, at.G_SPEED]] = dampers.shapes @ parts[:, [at.Q, at.Q_RATE]]
    grains[0, [at.G_PLACE, at.G_SPEED]] = state.grain, state.grain_velocity
    hits[:, at.D_MODE], hits[0, at.D_MODE] = at.ON_FLOOR, state.mode
    full = State(np.append(state.y, grains), np.append(state.n, hits))
    _lift(full, dampers, apart)
    return full


def displace(state: State, dampers: Dampers, by: float) -> None:
    """Displace the first mode with all grains [m], and lift each further grain off its floor by another part of that.

    Grains at rest would else all move alike, in every run that repeats this one.
    """
    state.y[at.STATE_SIZE + at.Q] += by
    state.dampers[1][:, at.G_PLACE] += by * dampers.shapes[:, 0]
    _lift(state, dampers, by)


def _lift(state: State, dampers: Dampers, apart: float) -> None:
    hits, grains = state.dampers
    room = dampers.table[:, at.FIXED_HEIGHT] - 2.0 * dampers.table[:, at.RADIUS]
    for k in range(1, len(hits)):
        if apart != 0.0 and hits[k, at.D_MODE] == at.ON_FLOOR and room[k] > 0.0:
            grains[k, at.G_PLACE] += min(abs(apart) * k / len(hits), 0.5 * room[k])
            hits[k, at.D_MODE] = at.FREE
