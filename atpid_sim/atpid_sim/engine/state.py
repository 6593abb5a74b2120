# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of a run: an array and counters that kernels change in place, with properties by name for callers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns
from atpid_sim.engine.columns import CONTACT_STEPS, FLIGHT_STEPS, REJECTED
from atpid_sim.kernel import kernel
from atpid_sim.system import Array

#: First step of a first contact, as the fourth root of a time [s^(1/4)]; later contacts start from their predecessor's.
FIRST_STEP = 0.05


@kernel
def steps_used(n):
    """Steps counted against the limit: those of contacts and flights, and the rejected ones."""
    return n[CONTACT_STEPS] + n[FLIGHT_STEPS] + n[REJECTED]


class _Value:
    """A place of the state vector by name, read as a float; its unit is that of the column."""

    def __init__(self, column: int) -> None:
        self._column = column

    def __get__(self, state: State, owner: type[State]) -> float:
        return float(state.y[self._column])


class _Count(_Value):
    """A counter by name."""

    def __get__(self, state: State, owner: type[State]) -> int:
        return int(state.n[self._column])


@dataclass
class State:
    """State vector y (STATE_SIZE,) and counters n (COUNTERS,), as named in `columns`; SI units."""

    y: Array
    n: NDArray[np.int64]

    time = _Value(columns.TIME)
    beam = _Value(columns.BEAM)
    beam_velocity = _Value(columns.BEAM_VELOCITY)
    grain = _Value(columns.GRAIN)
    grain_velocity = _Value(columns.GRAIN_VELOCITY)
    #: FREE, ON_FLOOR, ON_CEILING, OFF_FLOOR or OFF_CEILING of `columns`.
    mode = _Count(columns.MODE)
    floor_impacts = _Count(columns.FLOOR_HITS)
    ceiling_impacts = _Count(columns.CEILING_HITS)

    @staticmethod
    def resting(displacement: float, velocity: float, modes: Array | None = None) -> State:
        """Return a beam at `displacement` [m] with `velocity` [m/s] whose grain just touches the floor.

        modes: of a structure of several, parts (modes, 2) of both, which are then their sums.
        """
        y = np.zeros(columns.STATE_SIZE + (0 if modes is None else columns.MODE_COLUMNS * len(modes)))
        if modes is not None:
            y[columns.STATE_SIZE :].reshape(-1, columns.MODE_COLUMNS)[:, : columns.Q_RATE + 1] = modes
            displacement, velocity = modes.sum(axis=0)
        y[columns.BEAM] = y[columns.GRAIN] = displacement
        y[columns.BEAM_VELOCITY] = y[columns.GRAIN_VELOCITY] = velocity
        y[columns.LOWEST], y[columns.HIGHEST] = np.inf, -np.inf
        y[columns.FIRST_STEP] = FIRST_STEP
        n = np.zeros(columns.COUNTERS, dtype=np.int64)
        n[columns.MODE] = columns.ON_FLOOR
        return State(y, n)

    def without_ledger(self) -> State:
        """Keep no energy ledger from here on, a fifth of a run's time at `impact` and `finite`; return this state."""
        self.y[columns.INPUT] = np.nan
        return self

    def release_grain(self, height: float, velocity: float) -> None:
        """Put the grain in flight at `height` [m] above the floor, with `velocity` [m/s] upward."""
        self.y[columns.GRAIN] = self.y[columns.BEAM] + height
        self.y[columns.GRAIN_VELOCITY] = velocity
        self.n[columns.MODE] = columns.FREE

    def copy(self) -> State:
        """Return an independent copy."""
        return State(self.y.copy(), self.n.copy())

    @property
    def amplitude(self) -> float:
        """Half peak-to-peak of the beam in the observation window [m]."""
        return float(0.5 * (self.y[columns.HIGHEST] - self.y[columns.LOWEST]))

    @property
    def steps(self) -> int:
        """Steps counted against the limit."""
        return int(steps_used(self.n))

    def restart_observation(self) -> None:
        """Forget the range of the beam, the longest contact, and what was sampled and logged."""
        self.y[columns.LOWEST], self.y[columns.HIGHEST], self.y[columns.LONGEST] = np.inf, -np.inf, 0.0
        self.n[[columns.SAMPLE, columns.IMPACTS]] = 0

    def restart_steps(self) -> None:
        """Count steps from zero."""
        self.n[[columns.CONTACT_STEPS, columns.FLIGHT_STEPS, columns.REJECTED]] = 0
