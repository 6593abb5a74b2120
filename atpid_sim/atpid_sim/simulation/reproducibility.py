# SPDX-License-Identifier: Apache-2.0
"""Error and reproducibility of an amplitude: finer tolerances, disturbed starts, an ensemble where these diverge."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import Outcome
from atpid_sim.simulation.integration import Integration, Observation, negligible_displacement, sample_series
from atpid_sim.system import Array

#: Finer runs to compare with: share of the tolerance, and disturbance of the first displacement over the amplitude.
#: They lie below any sensor's resolution; smaller ones would decay in the closed damper before it opens.
_CHECKS = ((1e-2, 1e-5), (1e-2, -1e-5), (1e-3, 3e-6))
#: Steps of a run from which fewer and coarser checks are made, and which those are.
_EXPENSIVE, _FEW_CHECKS = 1_000_000, ((1e-1, 1e-5), (1e-1, -1e-5))
#: Disturbance of the drive, in model errors: what a model leaves out acts in another way than this does.
_MODEL = 5.0
#: Clearance over the diameter below which the ceiling holds the grain, as the engine has it.
_SHUT = 5e-6
#: Share of that disturbance by which the drive is larger throughout: no damping removes it.
_DRIVE = 1e-2
#: Columns of the drive table that are proportional to the support's motion.
_SUPPORT = [columns.A0, columns.A1, columns.C0, columns.C1, columns.C2, columns.C3]
#: Relative change of an amplitude that counts: at least, in tolerances, and at most.
_LEAST, _TOLERANCES, _MOST_ALLOWED = 1e-3, 20.0, 1e-2
#: Runs of an ensemble, their share of the tolerance, and the largest of their disturbances. One more run would lie
#: outside its range once in 17 times.
_ENSEMBLE, _ENSEMBLE_SHARE, _ENSEMBLE_REACH = 32, 1e-1, 1e-5
#: Further runs that have to agree where motions have diverged: an outcome with a probability of 3 % is missed by them
#: once in fifty.
_CONFIRMING = 96
#: Steps of all runs of an ensemble, in those of the run that is judged, from which it has fewer.
_TOGETHER = 8_000_000
#: Threshold of divergence: distance of two motions anywhere in the run, over their amplitude.
_DIVERGED = 1e-4
#: Instants a period at which motions are compared, and the most of them.
_PER_PERIOD, _MOST = 16, 20_000
#: Steps a finer run may take, in those of the run that is judged: a short one, beside 100 000, and a long one.
_FINER, _FINER_LONG = 20, 2


@dataclass(frozen=True)
class Verdict:
    """Relative numerical error of an amplitude, NaN: unknown; whether it is reproducible, else its spread [m]."""

    error: float
    reproducible: bool
    spread: tuple[float, float, float] | None


class _Motion(NamedTuple):
    amplitude: float  # in the steady window [m]
    beam: Array  # displacement throughout the run (n,) [m]


#: The verdict of an unchecked run: error unknown, and not reported as reproducible.
UNCHECKED = Verdict(float("nan"), False, None)


def judge(
    integration: Integration, amplitude: float, steps: int, model_error: float = 0.0, held_error: float = 0.0
) -> Verdict:
    """Repeat a run that took `steps` with finer tolerances and disturbances, and compare amplitudes [m].

    A run whose amplitude changes by more than a thousandth (or twenty tolerances, up to a hundredth) is not
    reproducible: it gets the spread of an ensemble beside its error. Where the motions diverge on the way and converge
    again, as after a chaotic transient, whether they do so in time is random: then the whole ensemble has to
    agree. A finer run that does not reach its end leaves the error unknown. model_error, held_error: relative errors of
    a fidelity level whose contacts come from a table, in the steady window and while the ceiling holds the grain; runs
    disturbed by five times as much, and what they differ by, count as well.
    """
    limit = max(_LEAST, min(_TOLERANCES * integration.rtol, _MOST_ALLOWED))
    again = _Repetition(integration, amplitude, steps)
    motions = [again.run(share, disturbance) for share, disturbance in (_CHECKS if steps < _EXPENSIVE else _FEW_CHECKS)]
    amplitudes = [motion.amplitude for motion in motions]
    if model_error > 0.0:
        amplitudes += [again.off_model(_MODEL * model_error, _MODEL * held_error, late) for late in (False, True)]
    negligible = negligible_displacement(integration.scene)
    worst = _worst(amplitudes, amplitude, negligible)
    if worst <= limit and not _diverged(motions):
        return Verdict(worst, True, None)
    amplitudes += again.ensemble(_ENSEMBLE)
    if _worst(amplitudes, amplitude, negligible) <= limit:
        amplitudes += again.ensemble(_CONFIRMING)
    worst = _worst(amplitudes, amplitude, negligible)
    if worst <= limit:
        return Verdict(worst, True, None)
    drawn = [amplitude, *amplitudes]
    return Verdict(worst, False, (float(np.nanmin(drawn)), float(np.nanmedian(drawn)), float(np.nanmax(drawn))))


def _worst(others: list[float], amplitude: float, negligible: float) -> float:
    """Return the largest relative distance beyond a negligible one [m]; NaN where one of the others is."""
    found = np.array(others)
    apart = np.maximum(np.abs(found - amplitude) - negligible, 0.0)
    return float(np.max(apart / np.maximum(np.abs(found), 1e-300)))


def _diverged(motions: list[_Motion]) -> bool:
    first = motions[0].beam
    amplitude = 0.5 * np.ptp(first) if len(first) else 0.0
    return any(bool(np.max(np.abs(other.beam - first), initial=0.0) > _DIVERGED * amplitude) for other in motions[1:])


@dataclass(frozen=True)
class _Repetition:
    """A run, ready to be repeated."""

    integration: Integration
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
        state = self.integration.initial_state()
        state.y[[columns.BEAM, columns.GRAIN]] += disturbance * self.amplitude
        table = self.integration.table.copy()
        table[:, _SUPPORT] *= 1.0 + _DRIVE * disturbance
        return self._motion(share, state, table, samples)

    def off_model(self, error: float, held_error: float, late: bool) -> float:
        """Return the amplitude [m] with a drive larger by the errors, or, `late`, smaller and late by that of held."""
        table = self.integration.table.copy()
        held = table[:, columns.HEIGHT] <= 2.0 * self.integration.system.radius * (1.0 + _SHUT)
        held &= table[:, columns.CEILING_VELOCITY] <= 0.0
        table[:, _SUPPORT] *= 1.0 - error if late else 1.0 + error
        if late:
            table[held, columns.PHASE] -= held_error
        else:
            table[np.ix_(np.flatnonzero(held), np.asarray(_SUPPORT))] *= 1.0 + held_error
        return self._motion(_CHECKS[0][0], self.integration.initial_state(), table, 0).amplitude

    def _motion(self, share: float, state: State, table: Array, samples: int) -> _Motion:
        scene, original = self.integration.scene, self.integration
        begin = state.time
        period = max(1.0 / (_PER_PERIOD * scene.frequency_hz), (scene.duration - begin) / _MOST)
        series = sample_series(min(samples, int((scene.duration - begin) / period)))
        limit = min(_FINER * self.steps + 100_000, max(_FINER_LONG * self.steps, original.step_limit))
        finer = Integration(scene, original.fidelity, max(share * original.rtol, 1e-12))
        outcome = finer.advance(state, table, Observation(scene.steady_window, begin, period, series), limit)
        return _Motion(state.amplitude if outcome == Outcome.DONE else float("nan"), series[columns.S_BEAM])
