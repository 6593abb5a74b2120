# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Section states: the numbers that determine the rest of a motion where the grain flies, and a state of the engine.

They are the displacement and velocity of each mode, then of the grain: (2 modes + 2,) [m, m/s, ...]. Of one mode these
are the beam's own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns as at
from atpid_sim.engine.state import State
from atpid_sim.kernel import kernel
from atpid_sim.system import Array

#: Places of the grain's numbers in a section state.
GRAIN, GRAIN_VELOCITY = -2, -1
#: Those of the modes' displacements and velocities.
MODES, MODES_VELOCITY = slice(0, -2, 2), slice(1, -2, 2)


class Sections(NamedTuple):
    """Where the numbers of a section state lie in the engine's state vector, and the rest of that."""

    places: NDArray[np.int64]  # (2 modes + 2,)
    flight: Array  # state vector of a flight at time zero without a ledger, into which they are entered

    def enter(self, y: Array, sections: Array) -> None:
        """Enter section states (..., 2 modes + 2) into state vectors (..., m)."""
        y[..., self.places] = sections
        if y.shape[-1] > at.STATE_SIZE:  # the container moves by the sum of its modes
            y[..., at.BEAM] = y[..., at.STATE_SIZE + at.Q :: at.MODE_COLUMNS].sum(axis=-1)
            y[..., at.BEAM_VELOCITY] = y[..., at.STATE_SIZE + at.Q_RATE :: at.MODE_COLUMNS].sum(axis=-1)

    def flying(self, section: Array) -> State:
        """Return the engine's state of a section state, at time zero."""
        state = State(self.flight.copy(), np.zeros(at.COUNTERS, dtype=np.int64))
        state.n[at.MODE] = at.FREE
        self.enter(state.y, section)
        return state


@lru_cache(maxsize=64)
def sections_of(count: int) -> Sections:
    """Return how section states lie in the engine's state vectors with so many modes; 0: `System.modes` is None."""
    places = [at.BEAM, at.BEAM_VELOCITY]
    if count:
        begins = at.STATE_SIZE + at.MODE_COLUMNS * np.arange(count)
        places = np.column_stack((begins + at.Q, begins + at.Q_RATE)).ravel().tolist()
    flight = State.resting(0.0, 0.0, np.zeros((count, 2)) if count else None).without_ledger().y
    return Sections(np.array([*places, at.GRAIN, at.GRAIN_VELOCITY]), flight)


def displaced_together(size: int) -> Array:
    """Return displacements (size - 2, size) of the modes of a section state that move the grain with the container."""
    together = np.eye(size)[:-2]
    together[::2, GRAIN] = together[1::2, GRAIN_VELOCITY] = 1.0
    return together


@kernel
def enter_section(modes, sections, section, y):
    """Enter a section state into a state vector."""
    for k in range(section.shape[0]):
        y[sections.places[k]] = section[k]
    if modes is not None:
        y[at.BEAM] = y[at.BEAM_VELOCITY] = 0.0
        for i in range(modes.shape[1]):
            begin = at.STATE_SIZE + i * at.MODE_COLUMNS
            y[at.BEAM] += y[begin + at.Q]
            y[at.BEAM_VELOCITY] += y[begin + at.Q_RATE]


@kernel
def leave_section(sections, y, section):
    """Enter the section state that a state vector has."""
    for k in range(section.shape[0]):
        section[k] = y[sections.places[k]]
