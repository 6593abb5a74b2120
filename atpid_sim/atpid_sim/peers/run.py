# SPDX-License-Identifier: Apache-2.0
"""One call for every peer: a scene, a method by name, a tolerance; what comes back is measured alike."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.peaks import between, half_peak_to_peak
from atpid_sim.peers.methods import PEERS
from atpid_sim.peers.rhs import mechanical_energy
from atpid_sim.peers.task import Array, PeerError, Task, Track, brief, task_of
from atpid_sim.scene import Scene


@dataclass(frozen=True)
class PeerResult:
    """What one peer made of one scene, in its steady window."""

    method: str
    tolerance: float  # relative tolerance [-]; for a fixed step, the step [s]
    wall_s: float  # the integration alone, compiled; of the computing thread, so that other programs do not count
    steps: int
    evaluations: int  # of the right-hand side
    times: Array  # (n,) rising, in the window [s]
    beam: Array  # displacement (n,) [m]
    beam_velocity: Array  # (n,) [m/s]
    beam_acceleration: Array  # (n,) [m/s^2]
    amplitude: float  # half peak-to-peak of the beam [m]
    energy_residual: float  # |gained - work done| over the support's work [-]
    escaped: bool  # whether the grain's centre was seen beyond a wall
    message: str  # "" where the method says it succeeded

    def beam_at(self, times: Array) -> Array:
        """Return the beam's displacement (k,) [m] at `times` (k,) [s] within the window."""
        return between(times, self.times, self.beam, self.beam_velocity, self.beam_acceleration)


def run_peer(scene: Scene, method: str, tolerance: float) -> PeerResult:
    """Run `scene` by the `method` (a key of PEERS) at a relative `tolerance` [-], for rk4 the step [s].

    The absolute tolerance is 1e-3 of the relative one, in SI units. The scene's controller is not run: a controlled
    ceiling stays closed. Raises PeerError for a method it does not know, or a law whose force is not one of overlap and
    rate alone (impact, walton_braun).
    """
    if method not in PEERS:
        raise PeerError(f"method: given {method!r}; allowed: {', '.join(PEERS)}")
    task = task_of(scene)
    run = PEERS[method]
    run(brief(task), max(tolerance, 1e-6))  # compiles, or loads what was compiled
    begin = time.thread_time()
    track = run(task, tolerance)
    wall = time.thread_time() - begin
    return _result(task, method, tolerance, wall, track)


def _result(task: Task, method: str, tolerance: float, wall: float, track: Track) -> PeerResult:
    every = np.vstack(track.points) if track.points else np.zeros((0, 5))
    _, first = np.unique(every[:, 0], return_index=True)
    times, x, v, a, _ = every[first].T
    amplitude = half_peak_to_peak(times, x, v, a) if len(times) > 1 and np.isfinite(x).all() else math.nan
    return PeerResult(
        method=method,
        tolerance=tolerance,
        wall_s=wall,
        steps=track.steps,
        evaluations=track.evaluations,
        times=times,
        beam=x,
        beam_velocity=v,
        beam_acceleration=a,
        amplitude=amplitude,
        energy_residual=_residual(task, track.final),
        escaped=track.escaped,
        message=track.message,
    )


def _residual(task: Task, final: Array) -> float:
    first = drive.support_displacement(task.rows, float(task.rows[0, columns.START]))
    last = drive.support_displacement(task.rows, float(task.rows[-1, columns.END]))
    gained = mechanical_energy(final, last, task.system) - mechanical_energy(task.start, first, task.system)
    given = abs(final[4]) or mechanical_energy(task.start, first, task.system)
    return float(abs(gained - final[5]) / abs(given))
