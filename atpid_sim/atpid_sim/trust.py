# SPDX-License-Identifier: Apache-2.0
"""How far to trust an amplitude: a second tolerance and disturbed starts, an ensemble where these come apart."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import drive, state
from atpid_sim.outcome import Outcome
from atpid_sim.run import Array, half_peak_to_peak, initial_state, nothing, step_budget, stepper_of
from atpid_sim.scene import Scene

#: Finer runs to compare with: share of the tolerance, and disturbance of the first displacement over the amplitude.
#: The disturbances are small against any sensor; a closed damper forgets them by its damping, hence not smaller still.
_CHECKS = ((1e-2, 1e-5), (1e-2, -1e-5), (1e-3, 3e-6))

#: Steps of a run from which fewer and coarser ones have to do, and which those are.
_DEAR, _FEW_CHECKS = 1_000_000, ((1e-1, 1e-5), (1e-1, -1e-5))

#: Share of that disturbance by which the drive is larger throughout: this no damping forgets.
_DRIVE = 1e-2

#: Columns of the drive table that say how the support moves.
_SUPPORT = [drive.A0, drive.A1, drive.C0, drive.C1, drive.C2, drive.C3]

#: Relative change of an amplitude that is one: at least, in tolerances, and at most.
_LEAST, _TOLERANCES, _MOST_ALLOWED = 1e-3, 20.0, 1e-2

#: Runs of an ensemble, their share of the tolerance, and the largest of their disturbances. One more run would lie
#: outside its range once in 17 times.
_ENSEMBLE, _ENSEMBLE_SHARE, _ENSEMBLE_REACH = 32, 1e-1, 1e-5

#: As many more have to agree where motions have come apart: an end that is met 3 times in a hundred is missed by them
#: once in fifty.
_ACQUITTAL = 96

#: Steps of all runs of an ensemble, in those of the run that is judged, from which it has fewer.
_TOGETHER = 8_000_000

#: Distance of two motions anywhere in the run, over the swing, from which chance has had a hand in it.
_APART = 1e-4

#: Instants a period at which motions are compared, and the most of them.
_PER_PERIOD, _MOST = 16, 20_000

#: Steps a finer run may take, in those of the run that is judged: a cheap one, beside 100 000, and a dear one.
_FINER, _FINER_DEAR = 20, 2


@dataclass(frozen=True)
class Verdict:
    """Relative numerical error of an amplitude, NaN: unknown; whether it is reproducible, else its spread [m]."""

    error: float
    reproducible: bool
    spread: tuple[float, float, float] | None


class _Motion(NamedTuple):
    amplitude: float  # in the steady window [m]
    beam: Array  # displacement throughout the run (n,) [m]


def unchecked() -> Verdict:
    """Return the verdict nobody asked for: error unknown, and so not called reproducible."""
    return Verdict(float("nan"), False, None)


def judge(scene: Scene, fidelity: str, rtol: float, table: Array, amplitude: float, steps: int) -> Verdict:
    """Repeat a run that took so many steps with finer tolerances and disturbances, and compare amplitudes.

    A run whose amplitude moves by more than a thousandth (or twenty tolerances, up to a hundredth) is not reproducible:
    it gets the spread of an ensemble beside its error. Where the motions come apart on the way and meet again, as after
    a chaotic transient, it is left to chance whether they meet in time: then the whole ensemble has to agree. A finer
    run that does not reach its end leaves the error unknown.
    """
    limit = max(_LEAST, min(_TOLERANCES * rtol, _MOST_ALLOWED))
    again = _Again(scene, fidelity, rtol, table, amplitude, steps)
    motions = [again.run(share, disturbance) for share, disturbance in (_CHECKS if steps < _DEAR else _FEW_CHECKS)]
    amplitudes = [motion.amplitude for motion in motions]
    still = nothing(scene)
    worst = _worst(amplitudes, amplitude, still)
    if worst <= limit and not _come_apart(motions):
        return Verdict(worst, True, None)
    amplitudes += again.ensemble(_ENSEMBLE)
    if _worst(amplitudes, amplitude, still) <= limit:
        amplitudes += again.ensemble(_ACQUITTAL)
    worst = _worst(amplitudes, amplitude, still)
    if worst <= limit:
        return Verdict(worst, True, None)
    drawn = [amplitude, *amplitudes]
    return Verdict(worst, False, (float(np.nanmin(drawn)), float(np.nanmedian(drawn)), float(np.nanmax(drawn))))


def _worst(others: list[float], amplitude: float, still: float) -> float:
    """Return the largest relative distance beyond what is no swing; NaN where one of the others is."""
    found = np.array(others)
    apart = np.maximum(np.abs(found - amplitude) - still, 0.0)
    return float(np.max(apart / np.maximum(np.abs(found), 1e-300)))


def _come_apart(motions: list[_Motion]) -> bool:
    first = motions[0].beam
    swing = 0.5 * np.ptp(first) if len(first) else 0.0
    return any(bool(np.max(np.abs(other.beam - first), initial=0.0) > _APART * swing) for other in motions[1:])


@dataclass(frozen=True)
class _Again:
    """A run, ready to be repeated."""

    scene: Scene
    fidelity: str
    rtol: float
    table: Array
    amplitude: float
    steps: int

    def ensemble(self, count: int) -> list[float]:
        """Return the amplitudes [m] of up to `count` disturbed runs; NaN where one does not reach its end."""
        count = min(count, _TOGETHER // max(self.steps, 1))
        disturbances = np.linspace(-_ENSEMBLE_REACH, _ENSEMBLE_REACH, count)
        with ThreadPoolExecutor() as pool:
            return list(pool.map(lambda d: self.run(_ENSEMBLE_SHARE, float(d), 0).amplitude, disturbances))

    def run(self, share: float, disturbance: float, samples: int = _MOST) -> _Motion:
        """Return a run with a share of the tolerance and a disturbed start and drive."""
        scene = self.scene
        y, n = initial_state(scene)
        for place in (state.BEAM, state.GRAIN):
            y[place] += disturbance * self.amplitude
        table = self.table.copy()
        table[:, _SUPPORT] *= 1.0 + _DRIVE * disturbance
        period = max(1.0 / (_PER_PERIOD * scene.frequency_hz), scene.duration / _MOST)
        out, log = np.zeros((state.ROWS, min(samples, int(scene.duration / period)))), np.zeros((0, state.COLUMNS))
        budget = min(_FINER * self.steps + 100_000, max(_FINER_DEAR * self.steps, step_budget(scene)))
        stepper = stepper_of(scene, self.fidelity, max(share * self.rtol, 1e-12))
        outcome = stepper(table, y, n, scene.steady_window, (0.0, period), out, log, budget)
        return _Motion(half_peak_to_peak(y) if outcome == Outcome.DONE else float("nan"), out[state.S_BEAM])
