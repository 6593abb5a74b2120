# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions over heights beside runs of each height for hundreds of periods, at the complete fidelity."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from atpid_dynamics.heights import opened
from atpid_dynamics.over_heights import HeightSweep, Way, over_heights
from atpid_sim.engine import columns, drive
from atpid_sim.outcome import Outcome
from atpid_sim.periodic.approach import rows_until
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import Batch, Workers
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation, sample_series
from studies.steady.systems import drawn

#: Periods that a height is run, how many of them are looked at, and largest change of what repeats itself.
_PERIODS, _SEEN, _SAME = 600, 64, 1e-5
#: Longest period that counts as repeating, relative tolerance of the runs, and error of the amplitude allowed.
_LONGEST, _RTOL, _ERROR = 8, 1e-6, 1e-4
#: Heights of a random system, and where they lie over the clearance drawn.
_HEIGHTS, _CLEARANCES = 64, (0.4, 1.2)


class Judged(NamedTuple):
    """What a long run comes to."""

    amplitude: float  # [m]
    periods: int  # after which it repeats itself; 0: it does not


def judge(scene: Scene, height: float) -> Judged:
    """Run a scene at a height [m] for hundreds of periods."""
    there = opened(scene, height)
    integration, period = Integration(there, complete_fidelity(there), _RTOL), 1.0 / there.frequency_hz
    end = there.duration + _PERIODS * period
    begin = end - _SEEN * period
    series, state = sample_series(_SEEN), integration.initial_state()
    rows = drive.cut(rows_until(there, end), [begin])
    outcome = integration.advance(state, rows, Observation((begin, end), begin, period, series))
    if outcome != Outcome.DONE:
        return Judged(math.nan, 0)
    looks = series[columns.S_BEAM] / state.amplitude
    for periods in range(1, _LONGEST + 1):
        if np.abs(looks[periods:] - looks[:-periods]).max() <= _SAME:
            return Judged(state.amplitude, periods)
    return Judged(state.amplitude, 0)


def compared(scene: Scene, found: HeightSweep, workers: Workers, progress: Callable[[int], None]) -> dict[str, Any]:
    """Return how many heights have the motion that a long run of each comes to, and the largest error of those."""
    heights = found.heights.tolist()
    judged = Batch(partial(judge, scene), heights).run(workers, progress)
    regular = np.array([one.periods > 0 for one in judged])
    errors = np.abs(found.amplitudes / np.array([one.amplitude for one in judged]) - 1.0)
    steady, same = found.periods > 0, errors <= np.maximum(_ERROR, np.nan_to_num(found.errors))
    return {
        "heights": len(heights),
        "regular": int(regular.sum()),
        "steady_found": int(steady.sum()),
        "by_neighbour": int((found.ways == Way.NEIGHBOUR).sum()),
        "same": int((steady & regular & same).sum()),
        "another": found.heights[steady & regular & ~same].tolist(),
        "not_regular": found.heights[steady & ~regular].tolist(),
        "regular_but_unsettled": int((regular & ~steady).sum()),
        "largest_error": float(errors[steady & regular & same].max(initial=0.0)),
        "above_1e-4": int((errors[steady & regular] > _ERROR).sum()),
    }


def random_system(seed: int, number: int, rtol: float, fidelity: str, workers: Workers) -> dict[str, Any]:
    """Return the same of a random system, at heights below and above the one drawn."""
    scene = drawn(seed, number)
    diameter = 2.0 * scene.grain.radius
    clearance = scene.ceiling.heights[-1][1] - diameter
    heights = diameter + clearance * np.linspace(*_CLEARANCES, _HEIGHTS)
    (found,) = over_heights([scene.with_(tolerance=rtol)], heights, fidelity, rtol, workers)
    return {"system": number} | compared(scene, found, workers, lambda _: None)
