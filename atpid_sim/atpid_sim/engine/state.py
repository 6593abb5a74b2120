# SPDX-License-Identifier: Apache-2.0
"""Where a run stands: names for the places of the kernels' arrays, and how they are made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine.kernel import kernel

# real state, float64 (SIZE,)
(
    TIME,  # [s]
    BEAM,  # displacement of beam and container floor [m]
    BEAM_RATE,  # [m/s]
    GRAIN,  # displacement of the grain; equal to BEAM where it just touches the floor [m]
    GRAIN_RATE,  # [m/s]
    MEMORY,  # deepest overlap of the present contact [m]
    INPUT,  # work done by the support [J]
    BEAM_LOSS,  # dissipated by the beam's damping [J]
    CONTACT_LOSS,  # absorbed by the contacts [J]
    CEILING_WORK,  # work done by the ceiling's drive [J]
    LOWEST,  # beam in the observation window [m]
    HIGHEST,
    TOUCHING,  # time in contact inside the window [s]
    FIRST_STEP,  # first step of the last contact, in its own variable
    LONGEST,  # longest single contact inside the window [s]
    BEGUN,  # when the present contact began [s]
    SIZE,
) = range(17)

# counters, int64 (COUNTS,)
MODE, FLOOR_HITS, CEILING_HITS, WINDOW_FLOOR, WINDOW_CEILING, CONTACT_STEPS, FLIGHT_STEPS, REJECTED, SAMPLE, EVENTS, LOW_HOPS, COUNTS = range(12)  # fmt: skip # noqa: E501

# modes
FREE, ON_FLOOR, ON_CEILING, OFF_FLOOR, OFF_CEILING = range(5)  # OFF_: overlapped, but without force

# rows of a sample series, float64 (ROWS, n)
S_SUPPORT, S_BEAM, S_RATE, S_ACCELERATION, S_GRAIN, S_CEILING, ROWS = range(7)

# columns of the impact log, float64 (capacity, 3): time [s], wall (+1 floor, -1 ceiling), closing speed [m/s]
E_TIME, E_WALL, E_SPEED, COLUMNS = range(4)


@kernel
def spent(n):  # type: ignore[no-untyped-def]
    """Steps of the budget that are used up: those of contacts and flights, and the rejected ones."""
    return n[CONTACT_STEPS] + n[FLIGHT_STEPS] + n[REJECTED]


def at_rest(beam: float, rate: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """State of a beam at `beam` [m] with `rate` [m/s] whose grain just touches the floor and moves with it."""
    y = np.zeros(SIZE)
    y[BEAM] = y[GRAIN] = beam
    y[BEAM_RATE] = y[GRAIN_RATE] = rate
    y[LOWEST], y[HIGHEST] = np.inf, -np.inf
    n = np.zeros(COUNTS, dtype=np.int64)
    n[MODE] = ON_FLOOR
    return y, n
