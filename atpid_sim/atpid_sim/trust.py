# SPDX-License-Identifier: Apache-2.0
"""How far to trust an amplitude: a second tolerance and disturbed starts, an ensemble where these come apart."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import state
from atpid_sim.outcome import Outcome
from atpid_sim.run import Array, Stepper, half_peak_to_peak, initial_state, step_budget, stepper_of
from atpid_sim.scene import Scene

#: Finer runs to compare with: share of the tolerance, and relative disturbance of the first displacement. The
#: disturbances are small against any sensor; a closed damper forgets them by its damping, hence not smaller still.
_CHECKS = ((1e-2, 1e-5), (1e-2, -1e-5), (1e-3, 3e-6))

#: Runs of an ensemble, their share of the tolerance, and the largest of their disturbances. One more run would lie
#: outside its range once in 17 times.
_ENSEMBLE, _ENSEMBLE_SHARE, _ENSEMBLE_REACH = 32, 1e-1, 1e-5

#: Distance of two motions anywhere in the run, over the swing, from which chance has had a hand in it.
_APART = 1e-4

#: Instants a period at which motions are compared, and the most of them.
_PER_PERIOD, _MOST = 16, 20_000

#: Steps of a finer run, as a multiple of those of the run that is judged.
_FINER = 10


@dataclass(frozen=True)
class Verdict:
    """Relative numerical error of an amplitude, whether it is reproducible, and its spread [m] where it is not."""

    error: float
    reproducible: bool
    spread: tuple[float, float, float] | None


class _Motion(NamedTuple):
    amplitude: float  # in the steady window [m]
    beam: Array  # displacement throughout the run (n,) [m]


def unchecked() -> Verdict:
    """Return the verdict nobody asked for: error unknown, and so not called reproducible."""
    return Verdict(float("nan"), False, None)


def judge(scene: Scene, fidelity: str, rtol: float, table: Array, amplitude: float) -> Verdict:
    """Repeat a run with finer tolerances and disturbed starts, and compare amplitudes.

    A run whose amplitude moves by more than a thousandth (or twenty tolerances) is not reproducible: it gets the spread
    of an ensemble beside its error. Where the motions come apart on the way and meet again, as after a chaotic
    transient, it is left to chance whether they meet in time: then the whole ensemble has to agree.
    """
    limit = max(1e-3, 20.0 * rtol)
    worst = 0.0
    motions: list[_Motion] = []
    for share, disturbance in _CHECKS:
        motions.append(_run(scene, stepper_of(scene, fidelity, max(share * rtol, 1e-12)), table, disturbance))
        worst = max(worst, _off(motions[-1].amplitude, amplitude))
        if not worst <= limit:
            return Verdict(worst, False, _range([amplitude, *_ensemble(scene, fidelity, rtol, table)]))
    if _come_apart(motions):
        amplitudes = _ensemble(scene, fidelity, rtol, table)
        worst = max(worst, *(_off(other, amplitude) for other in amplitudes))
        if not worst <= limit:
            return Verdict(worst, False, _range([amplitude, *amplitudes]))
    return Verdict(worst, True, None)


def _off(other: float, amplitude: float) -> float:
    return abs(other - amplitude) / max(abs(other), 1e-300)


def _come_apart(motions: list[_Motion]) -> bool:
    first = motions[0].beam
    swing = 0.5 * np.ptp(first)
    return any(bool(np.max(np.abs(other.beam - first)) > _APART * swing) for other in motions[1:])


def _ensemble(scene: Scene, fidelity: str, rtol: float, table: Array) -> list[float]:
    """Return the amplitudes [m] of an ensemble of disturbed starts."""
    stepper = stepper_of(scene, fidelity, max(_ENSEMBLE_SHARE * rtol, 1e-12))
    disturbances = np.linspace(-_ENSEMBLE_REACH, _ENSEMBLE_REACH, _ENSEMBLE)
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda d: _run(scene, stepper, table, float(d), 0).amplitude, disturbances))


def _range(amplitudes: list[float]) -> tuple[float, float, float]:
    return float(np.nanmin(amplitudes)), float(np.nanmedian(amplitudes)), float(np.nanmax(amplitudes))


def _run(scene: Scene, stepper: Stepper, table: Array, disturbance: float, samples: int = _MOST) -> _Motion:
    """Return a disturbed run; its amplitude is NaN where it does not reach its end."""
    y, n = initial_state(scene, disturbance)
    period = max(1.0 / (_PER_PERIOD * scene.frequency_hz), scene.duration / _MOST)
    out, log = np.zeros((state.ROWS, min(samples, int(scene.duration / period)))), np.zeros((0, state.COLUMNS))
    outcome = stepper(table, y, n, scene.steady_window, (0.0, period), out, log, _FINER * step_budget(scene))
    return _Motion(half_peak_to_peak(y) if outcome == Outcome.DONE else float("nan"), out[state.S_BEAM])
