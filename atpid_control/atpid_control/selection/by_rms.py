# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The height of least root mean square under an excitation that does not repeat itself: `direct` without an amplitude.

All heights are run under the same realisation, so that their differences have a smaller error than each of them. What
is least among many is too small by chance: a random motion is run again in another realisation, and that is shown.
"""

import math
import time
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from atpid_control.selection.protocol import Selection, SelectionError, SelectionStage
from atpid_sim.engine import columns, drive
from atpid_sim.maps.response import LEAST_USE
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.scene.excitation import RandomExcitation
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import Integration, drive_table
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.simulation.unrepeated import (
    few_samples,
    linear_motions,
    mean_error,
    mean_squares,
    observation_of,
    ratio_error,
)
from atpid_sim.system import Array

#: Clearances looked at first, from and to these shares of half a period at the closed damper's root mean square
#: velocity times the root of two; then so many between the best and each neighbour, so many times.
_LEAST, _MOST, _COUNT, _BETWEEN, _ROUNDS = 0.05, 4.0, 28, 3, 2
#: Heights differ where their root mean squares do by more than so many standard errors of the ratio.
_SURE = 2.0


class _Rated(NamedTuple):
    """The structure at one height."""

    height: float  # [m]
    squares: Array  # mean squares of the container over each period of the resonance (k,) [m^2]

    @property
    def rms(self) -> float:
        """Root mean square about the mean [m]."""
        return math.sqrt(float(np.mean(self.squares)))


class Realisation:
    """One drive of a scene, under which heights are compared."""

    def __init__(self, scene: Scene) -> None:
        """Take the scene; its ceiling is not used."""
        self._scene = scene.with_(height=2.0 * scene.grain.radius)
        self._table = drive_table(self._scene, scene.steady_window)
        self._length = max(1, round(1.0 / (scene.natural_frequency_hz * observation_of(scene).period)))
        closed, bare = linear_motions(self._scene, self._table)
        self.closed, self.bare = (mean_squares(each, self._length) for each in (closed, bare))

    def rated(self, height: float) -> _Rated:
        """Return what the structure does at a height [m]. Raises NumericalFailure."""
        scene = self._scene.with_(height=height)
        table = drive.with_ceiling(self._table, scene.ceiling.heights)
        run = Integration(scene, choose(scene).fidelity, table=table).run(observation_of(scene))
        return _Rated(height, mean_squares(run.samples[columns.S_BEAM], self._length))


def least_rms(scene: Scene) -> tuple[Selection, float, list[str]]:
    """Return the height of least root mean square, what it is without the damper [m], and warnings.

    The selection's `beam_amplitude` is a root mean square [m] as well. Raises SelectionError.
    """
    begun = time.perf_counter()
    diameter, (low, high) = 2.0 * scene.grain.radius, scene.height_limits
    try:
        own = Realisation(scene)
        swing = math.pi * math.sqrt(2.0 * float(np.mean(own.closed)))
        if not swing > 0.0:
            raise SelectionError("excitation: the closed damper does not move in the steady window; nothing to select")
        within = np.unique(np.clip(diameter + swing * np.geomspace(_LEAST, _MOST, _COUNT), low, high))
        seen = _run(own, [float(height) for height in within])
        for _ in range(_ROUNDS):
            seen += _run(own, _between(seen))
        best = min(seen, key=lambda one: one.rms)
        again = _again(scene, best.height)
    except NumericalFailure as error:
        raise SelectionError(f"direct: {error}") from error
    seen.sort(key=lambda one: one.height)
    spread, independent = mean_error(best.squares)
    share, share_error = efficiency(best.rms, _rms(own.closed)), ratio_error(best.squares, own.closed)
    note = f"RMS {best.rms:.4g} ± {0.5 * spread / best.rms:.2g} m, efficiency {share:.3f} ± {share_error:.2g}"
    stages = [
        SelectionStage("RMS", best.height, best.rms, note),
        SelectionStage("as good", best.height, best.rms, _as_good(seen, best)),
        *again,
    ]
    found = best.height, best.rms, share, "direct", len(seen) + len(again), time.perf_counter() - begun
    chosen = Selection(*found, stages=tuple(stages), note=stages[1].note)
    if share < LEAST_USE:
        shut = low <= diameter * (1.0 + 1e-9)
        stays = "it stays closed" if shut else f"the ceiling stays at its lowest, {low:g} m"
        takes = f"the best height found, {best.height:.4f} m, takes {100.0 * share:.1f} % off the RMS"
        left, kept = (_rms(own.closed), 0.0) if shut else (math.nan, math.nan)
        why = f"the damper is of no use: {takes}; {stays}"
        chosen = replace(chosen, height=low, beam_amplitude=left, efficiency=kept, no_use=why)
    return chosen, _rms(own.bare), few_samples({"independent_samples": independent})


def _run(own: Realisation, heights: list[float]) -> list[_Rated]:
    return [found for _, found in on_all_cores(own.rated, heights)]


def _rms(squares: Array) -> float:
    return math.sqrt(float(np.mean(squares)))


def _between(seen: list[_Rated]) -> list[float]:
    """Return heights between the best seen and its neighbours [m]."""
    heights = sorted(one.height for one in seen)
    place = heights.index(min(seen, key=lambda one: one.rms).height)
    near = heights[max(place - 1, 0) : place + 2]
    return [float(h) for a, b in pairwise(near) for h in np.linspace(a, b, _BETWEEN + 2)[1:-1]]


def _as_good(seen: list[_Rated], best: _Rated) -> str:
    """Return which of the heights are as good as the best within the error, and by how much their neighbours are worse.

    seen: rising in height.
    """
    compared = [(one.rms / best.rms - 1.0, ratio_error(one.squares, best.squares)) for one in seen]
    worse = [more > _SURE * error for more, error in compared]
    place = next(k for k, one in enumerate(seen) if one.height == best.height)
    first = next((k + 1 for k in range(place - 1, -1, -1) if worse[k]), 0)
    last = next((k - 1 for k in range(place + 1, len(seen)) if worse[k]), len(seen) - 1)
    elsewhere = [one.height for k, one in enumerate(seen) if not worse[k] and not first <= k <= last]
    text = f"{seen[first].height:.4f} to {seen[last].height:.4f} m are no worse within {_SURE:g} standard errors"
    if first == last:
        text = "its neighbours are worse"
    if elsewhere:
        text += f", nor are {len(elsewhere)} heights elsewhere, {min(elsewhere):.4f} to {max(elsewhere):.4f} m"
    beside = [
        f"{seen[k].height:.4f} m by {100.0 * compared[k][0]:.2g} ± {100.0 * compared[k][1]:.1g} %"
        for k in (first - 1, last + 1)
        if 0 <= k < len(seen)
    ]
    return f"{text}; worse: {', '.join(beside)}" if beside else text


def _again(scene: Scene, height: float) -> list[SelectionStage]:
    """Return what the height does in another realisation of a random motion."""
    excitation = scene.excitation
    if not isinstance(excitation, RandomExcitation):
        return []
    seed = scene.seed if excitation.random.seed is None else excitation.random.seed
    block = {"random": excitation.random.model_dump(exclude_none=True) | {"seed": seed + 1}}
    other = Realisation(scene.with_(excitation=block))
    found = other.rated(height)
    share, error = efficiency(found.rms, _rms(other.closed)), ratio_error(found.squares, other.closed)
    note = f"seed {seed + 1}, with which it was not selected: efficiency {share:.3f} ± {error:.2g}"
    return [SelectionStage("again", height, found.rms, note)]
