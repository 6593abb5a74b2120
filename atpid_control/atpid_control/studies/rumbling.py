# SPDX-License-Identifier: Apache-2.0
"""How long a run was in rumble, by the true motion: the measure of the bench, not the watch of the controller.

A period rumbles where the beam's amplitude is more than 15 % above that of the height map and is not decaying, the
ceiling being near or above the best height. Up to four periods in between are bridged: rumble is irregular.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from atpid_control.loop.step_back import DECAY, DECAY_SPAN
from atpid_control.studies.pure_loop import LoopRun
from atpid_sim.maps import MapEntry

Array = NDArray[np.float64]

#: Share above the map's amplitude from which a period rumbles, and share of the best height from which it can.
EXCESS, NEAR = 0.15, 0.95

_BRIDGED = 4


def longest_rumble(run: LoopRun, stage: tuple[float, float], best: MapEntry) -> float:
    """Return the longest stretch of rumble [s] within a stage (t0, t1) [s]; `best`: the map's height and amplitude."""
    period = 1.0 / run.scene.frequency_hz
    peaks = amplitudes(run)
    ends = period * np.arange(1, peaks.size + 1)
    heights = np.interp(ends, run.time, run.heights)
    inside = (ends - period >= stage[0]) & (ends <= stage[1])
    bad = inside & (peaks > (1.0 + EXCESS) * best.amplitude) & (heights > NEAR * best.height) & ~_decaying(peaks)
    return period * _longest(np.flatnonzero(bad))


def amplitudes(run: LoopRun) -> Array:
    """Return half the peak-to-peak (n,) [m] of the true beam in each whole period of the excitation."""
    beam, length = run.beam, run.scene.sensors.laser.rate / run.scene.frequency_hz
    edges = np.round(length * np.arange(int(beam.size / length) + 1)).astype(int)
    return np.array([0.5 * np.ptp(beam[a:b]) for a, b in pairwise(edges)])


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
