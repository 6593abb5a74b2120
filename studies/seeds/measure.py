# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes through the loop without the graph, each with many noises: height, efficiency and rumble of every stage."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_control.loop.hold import DECAY, DECAY_SPAN
from atpid_control.selection.map_cache import amplitudes_of
from atpid_control.stand.parameters import Parameters
from atpid_control.stand.parts import NODES
from atpid_control.views.report.stages import WINDOW, constant_intervals
from atpid_sim.maps import DamperResponse, HeightMap, MapEntry
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.excitation import amplitude_at
from atpid_sim.simulation.quantities import amplitudes_per_period, efficiency, half_peak_to_peak
from atpid_sim.system import Array
from studies.pure_loop import LoopRun, controlled, run_loop

#: Share above the map's amplitude from which a period rumbles, and share of the best height from which it can.
EXCESS, NEAR = 0.15, 0.95
_BRIDGED = 4


def longest_rumble(run: LoopRun, stage: tuple[float, float], best: MapEntry) -> float:
    """Return the longest stretch of rumble [s] within a stage (t0, t1) [s]; `best`: the map's height and amplitude.

    By the true motion, the measure of the bench, not by the watch of the controller: a period rumbles where the beam's
    amplitude is more than 15 % above that of the map and is not decaying, the ceiling being near or above the best
    height. Up to four periods in between are bridged: rumble is irregular.
    """
    period = 1.0 / run.scene.frequency_hz
    peaks = amplitudes(run)
    ends = period * np.arange(1, peaks.size + 1)
    heights = np.interp(ends, run.time, run.heights)
    inside = (ends - period >= stage[0]) & (ends <= stage[1])
    bad = inside & (peaks > (1.0 + EXCESS) * best.amplitude) & (heights > NEAR * best.height) & ~_decaying(peaks)
    return period * _longest(np.flatnonzero(bad))


def amplitudes(run: LoopRun) -> Array:
    """Return half the peak-to-peak (n,) [m] of the true beam in each whole period of the excitation."""
    return amplitudes_per_period(run.beam, run.scene.sensors.laser.rate / run.scene.frequency_hz)


def _decaying(peaks: Array) -> NDArray[np.bool_]:
    """Return which periods (n,) decay: against the last one and against the one before the span."""
    last = np.concatenate((peaks[:1], peaks[:-1]))
    before = np.concatenate((np.full(min(DECAY_SPAN, peaks.size), np.inf), peaks[:-DECAY_SPAN]))
    decaying: NDArray[np.bool_] = (peaks < DECAY * last) & (peaks < DECAY * before)
    return decaying


def _longest(places: NDArray[np.intp]) -> int:
    """Length of the longest run of indices (n,), gaps of up to `_BRIDGED` included."""
    if places.size == 0:
        return 0
    groups = np.split(places, np.flatnonzero(np.diff(places) > _BRIDGED + 1) + 1)
    return int(max(group[-1] - group[0] + 1 for group in groups))


@dataclass(frozen=True)
class Stage:
    """One interval of constant excitation in one run."""

    t0: float  # [s]
    t1: float  # [s]
    excitation_amplitude: float  # true [m]
    identified_amplitude: float  # mean of the estimates in the last 2 s [m]
    height: float  # of the ceiling at the end [m]
    amplitude: float  # half peak-to-peak of the true beam in the last 2 s [m]
    efficiency: float  # 1 - amplitude / closed damper's [-]
    rumble: float  # longest stretch [s]


@dataclass(frozen=True)
class SeedRun:
    """One run: its stages, and how many events the controller published."""

    scene: str
    seed: int
    stages: tuple[Stage, ...]
    step_backs: int
    drifts: int


def configured() -> Parameters:
    """Return the parameters of identifier and selector as their parameter files have them."""
    return {name: NODES[name].configured() for name in ("identifier_node", "selector_node")}


def run_seed(
    path: Path, seed: int, parameters: Mapping[str, Mapping[str, Any]], decibels: float | None, height_map: Path
) -> SeedRun:
    """Run one scene with one seed and return its results."""
    scene = noisy(load_scene(path), seed, decibels)
    used = height_map if controlled(scene).controller == "lookup" else None
    ran = run_loop(scene, parameters, used)
    stages = tuple(measured(ran, HeightMap.load(height_map)))
    return SeedRun(path.stem, seed, stages, len(ran.events("step_back")), len(ran.events("drift")))


def noisy(scene: Scene, seed: int, decibels: float | None) -> Scene:
    """Return the scene with another seed and, where given, the laser's noise so far below its smallest amplitude."""
    if decibels is None:
        return scene.with_(seed=seed)
    noise = amplitudes_of(scene)[0] * math.sqrt(0.5) * 10.0 ** (-decibels / 20.0)
    sensors = scene.sensors.model_dump(mode="json")
    sensors["laser"]["noise"] = noise
    return scene.with_(seed=seed, sensors=sensors)


def measured(ran: LoopRun, height_map: HeightMap) -> Iterator[Stage]:
    """Yield the stages of a run."""
    scene, rate = ran.scene, ran.scene.sensors.laser.rate
    damper, fraction, beam = DamperResponse(scene, 1e-5), scene.grain.mass_fraction, ran.beam
    for t0, t1 in constant_intervals(scene, scene.duration):
        a0 = amplitude_at(scene, t0)
        window = [k for k, t in enumerate(ran.time) if t1 - WINDOW < t <= t1]
        amplitude = half_peak_to_peak(beam[round((t1 - WINDOW) * rate) : round(t1 * rate)])
        yield Stage(
            t0=t0,
            t1=t1,
            excitation_amplitude=a0,
            identified_amplitude=float(np.mean([ran.estimates[k].amplitude for k in window])),
            height=ran.heights[window[-1]],
            amplitude=amplitude,
            efficiency=efficiency(amplitude, damper.closed_amplitude(a0)),
            rumble=longest_rumble(ran, (t0, t1), height_map.lookup(a0, fraction)),
        )
