# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many simulations of the thesis's range at once, and how fast they go."""

import time
from typing import NamedTuple

import numpy as np

from atpid_dynamics.heights import ends_alike, tables_at
from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import HERE, Batch, Progress, Workers
from atpid_sim.simulation.integration import Integration, failure_at
from atpid_sim.system import Array

#: Runs of a chunk: its Python takes 0.2 ms, its runs 5 ms or more. Chunks are handed out one by one, so that a worker
#: with cheap heights gets more of them.
_CHUNK = 16


class Sweep(NamedTuple):
    """Results over heights (n,), and what they took."""

    amplitudes: Array  # half peak-to-peak of the beam in the steady window (n,) [m]
    impacts: Array  # on floor and ceiling (n,)
    integration_s: Array  # of each, compiled: the mean of its chunk (n,) [s]
    wall_s: float


def sweep(
    scene: Scene,
    lowest: float,
    highest: float,
    count: int,
    rtol: float | None = None,
    fidelity: str = "soft",
    progress: Progress | None = None,
    workers: Workers = HERE,
) -> Sweep:
    """Simulate a scene at `count` heights [m], each once.

    A ceiling that moves goes to the height in its last ramp, a fixed one is put there. What the runs have in
    common before that ramp is integrated once a chunk. `progress` is called with the number done. Raises SceneError
    where a controller moves the ceiling, ValueError for less than one height, NumericalFailure, ClusterError.
    """
    if count < 1:
        raise ValueError(f"count: given {count}; allowed: at least 1 height")
    heights = np.linspace(lowest, highest, count)
    chunks = [heights[place : place + _CHUNK] for place in range(0, count, _CHUNK)]
    at_heights(scene, heights[-1:], fidelity, rtol)  # compiles, or loads what was compiled
    begin = time.perf_counter()
    batch = Batch(lambda place: at_heights(scene, chunks[place], fidelity, rtol), range(len(chunks)))

    def report(chunks_done: int) -> None:
        if progress is not None:
            progress(min(chunks_done * _CHUNK, count))

    done = batch.run(workers, report)
    wall = time.perf_counter() - begin
    amplitudes, impacts, times = (np.concatenate(column) for column in zip(*done, strict=True))
    return Sweep(amplitudes, impacts, times, wall)


def at_heights(scene: Scene, heights: Array, fidelity: str, rtol: float | None) -> tuple[Array, Array, Array]:
    """Return amplitudes, impacts and times, as in `Sweep`, of a scene at heights (n,) [m]; raises as `sweep`."""
    widest, tables, common = tables_at(scene, heights)
    integration = Integration(widest, fidelity, rtol, table=tables[0])
    begun, first = time.perf_counter(), integration.initial_state()
    y, n, outcomes = ends_alike(integration, first, tables, common)
    wall = time.perf_counter() - begun
    ends = [State(*each) for each in zip(y, n, strict=True)]
    for state, outcome in zip(ends, outcomes.tolist(), strict=True):
        if outcome != Outcome.DONE:
            raise NumericalFailure(failure_at(Outcome(outcome), state))
    impacts = n[:, columns.FLOOR_HITS] + n[:, columns.CEILING_HITS]
    return np.array([state.amplitude for state in ends]), impacts.astype(float), np.full(len(ends), wall / len(ends))


def standard_task(amplitude: float, fraction: float, height: float) -> Scene:
    """Return the standard bench for 16 s, closed until 6 s, open from 7 s on."""
    return standard_bench(
        grain={"mass_fraction": fraction, "radius": 0.0085},
        excitation={"amplitude": amplitude, "frequency": "resonance"},
        ceiling={"closed": 0.017, "open": height, "start": 6.0, "end": 7.0},
        steady_window=[14.0, 16.0],
    )
