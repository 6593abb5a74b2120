# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Error and reproducibility of an amplitude: finer tolerances, disturbed starts, an ensemble where these diverge."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import Outcome
from atpid_sim.simulation.fidelity import Choice, finite_error, held_error
from atpid_sim.simulation.integration import SUPPORT, Integration, Observation, negligible_displacement, sample_series
from atpid_sim.system import Array

#: Finer runs to compare with: share of the tolerance, and disturbance of the first displacement over the amplitude.
#: They lie below any sensor's resolution; smaller ones would decay in the closed damper before it opens.
_CHECKS = ((1e-2, 1e-5), (1e-2, -1e-5), (1e-3, 3e-6))
#: Steps of a run from which fewer and coarser checks are made, and which those are.
_EXPENSIVE, _FEW_CHECKS = 1_000_000, ((1e-1, 1e-5), (1e-1, -1e-5))
#: Disturbance of the drive, in model errors: what a model leaves out acts in another way than this does. At most so
#: much: a larger one makes another scene.
_MODEL, _MOST_OFF = 5.0, 0.05
#: Runs of an ensemble fill the other two kinds of disturbance evenly, each this far behind the one before (Roberts,
#: "The unreasonable effectiveness of quasirandom sequences", 2018).
_EVENLY = np.array([0.7548776662466927, 0.5698402909980532])
#: Clearance over the diameter below which the ceiling holds the grain, as the engine has it.
_SHUT = 5e-6
#: Share of that disturbance by which the drive is larger throughout: no damping removes it.
_DRIVE = 1e-2
#: Relative change of an amplitude that counts: at least, in tolerances, and at most.
_LEAST, _TOLERANCES, _MOST_ALLOWED = 1e-3, 20.0, 1e-2
#: That of the first checks, and what is stated at least where nothing is integrated: rounding.
_SLIGHT, _ROUNDING, _INTEGRATED = _DRIVE * 1e-5, 1e-12, ("soft", "finite")
#: Runs of an ensemble, their share of the tolerance, and the largest of their disturbances. One more run would lie
#: outside its range once in 17 times.
_ENSEMBLE, _ENSEMBLE_SHARE, _ENSEMBLE_REACH = 32, 1e-1, 1e-5
#: Runs where only a disturbance as large as the model error grows: more would take a tenth of all time.
_GLANCE = 16
#: Further runs that have to agree where motions have diverged: an outcome with a probability of 3 % is missed by them
#: once in fifty.
_CONFIRMING = 96
#: Steps of all runs of an ensemble, in those of the run that is judged, from which it has fewer.
_TOGETHER = 8_000_000
#: Threshold of divergence: distance of two motions anywhere in the run, over their amplitude.
_DIVERGED = 1e-4
#: Growth of a disturbance as large as a model error from which on a motion may end elsewhere: in regular ones it is 1.
_GROWN = 4.0
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
    change: float = float("nan")  # relative change of the drive, up to which the repeated runs were disturbed


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
    reproducible: it gets the spread of an ensemble beside its error. The error is the largest change, and what the
    finer runs, whose tolerance has an error of its own, differ by. Where the motions diverge on the way and converge
    again, as after a chaotic transient, whether they do so in time is random: then the whole ensemble has to agree,
    disturbed by as much as the run itself may be wrong, and the error is what any two of it differ by. A finer run that
    does not reach its end leaves the error unknown. model_error, held_error: relative errors of a fidelity level whose
    contacts come from a table, in the steady window and while the ceiling holds the grain; runs disturbed by five times
    as much count as well. Where these disturbances grow, some of the ensemble have to agree. What a regular motion
    answers to a larger drive is no spread: as much more is allowed, and a spread is of runs disturbed less.
    """
    limit = max(_LEAST, min(_TOLERANCES * integration.rtol, _MOST_ALLOWED))
    off, held = (min(_MODEL * error, _MOST_OFF) for error in (model_error, held_error))
    again = _Repetition(integration, amplitude, steps, off, held)
    allowed = limit + _GROWN * (again.off + again.held)
    checks = _CHECKS if steps < _EXPENSIVE else _FEW_CHECKS
    motions = [again.run(share, _Disturbance(part, _DRIVE * part), _MOST) for share, part in checks]
    finer = [motion.amplitude for motion in motions]
    larger = again.off_model() if model_error > 0.0 else []
    disturbed = [motion.amplitude for motion in larger]
    negligible = negligible_displacement(integration.scene)
    least = integration.rtol if integration.fidelity in _INTEGRATED else _ROUNDING

    def verdict(drawn: list[float], within: float, change: float) -> Verdict:
        error, agreed = max(_range(drawn), least), _range(drawn, negligible) <= within
        spread = (float(np.nanmin(drawn)), float(np.nanmedian(drawn)), float(np.nanmax(drawn)))
        return Verdict(error, agreed, None if agreed else spread, change)

    agree = _worst(finer, amplitude, negligible) <= limit and not _diverged(motions)
    regular = not _diverged([motions[0], *larger], again.off_allowed)
    if agree and regular and _worst([amplitude, *disturbed], amplitude, negligible) <= allowed:
        error = _worst([*finer, *disturbed], amplitude) + _range(finer)
        return Verdict(max(error, least), True, None, max(_SLIGHT, again.off))
    if agree:  # only disturbances as large as the model error grow
        drawn = [amplitude, *finer, *disturbed, *again.ensemble(_GLANCE, again.model_reach)]
        if not _range(drawn, negligible) <= limit:
            drawn += again.ensemble(_ENSEMBLE, again.model_reach)
        return verdict(drawn, allowed, again.model_reach)
    drawn = [amplitude, *finer, *again.ensemble(_ENSEMBLE, again.reach)]
    if not _range(drawn, negligible) <= limit:
        return verdict(drawn, limit, again.reach)
    return verdict([*drawn, *disturbed, *again.ensemble(_CONFIRMING, again.model_reach)], allowed, again.model_reach)


def _worst(others: list[float], amplitude: float, negligible: float = 0.0) -> float:
    """Return the largest relative distance beyond a negligible one [m]; NaN where one of the others is."""
    found = np.array(others)
    apart = np.maximum(np.abs(found - amplitude) - negligible, 0.0)
    return float(np.max(apart / np.maximum(np.abs(found), 1e-300)))


def _range(drawn: list[float], negligible: float = 0.0) -> float:
    """Return what amplitudes [m] differ by, beyond a negligible one, relative to the least; NaN where one is."""
    least, most = float(np.min(drawn)), float(np.max(drawn))
    return max(most - least - negligible, 0.0) / max(least, 1e-300)


def _diverged(motions: list[_Motion], allowed: float = _DIVERGED) -> bool:
    """Return whether motions are farther from the first than allowed, anywhere in the run, over its amplitude."""
    first = motions[0].beam
    amplitude = 0.5 * np.ptp(first) if len(first) else 0.0
    return any(bool(np.max(np.abs(other.beam - first), initial=0.0) > allowed * amplitude) for other in motions[1:])


class _Disturbance(NamedTuple):
    """In what a repeated run differs."""

    start: float = 0.0  # first displacement, over the amplitude
    drive: float = 0.0  # size of the drive, relative
    held: float = 0.0  # the same, while the ceiling holds the grain
    late: float = 0.0  # phase of the drive then [rad]


@dataclass(frozen=True)
class _Repetition:
    """A run, ready to be repeated."""

    integration: Integration
    amplitude: float
    steps: int
    off: float  # disturbances of the drive in place of what a model leaves out, relative: throughout,
    held: float  # and while the ceiling holds the grain

    @property
    def reach(self) -> float:
        """Largest relative disturbance of the drive in an ensemble: by what the tolerance may make a run wrong."""
        return max(_SLIGHT, min(self.integration.rtol, _MOST_ALLOWED / _TOLERANCES))

    @property
    def model_reach(self) -> float:
        """The same with what a model leaves out."""
        return max(self.reach, self.off)

    def ensemble(self, count: int, reach: float) -> list[float]:
        """Return the amplitudes [m] of up to `count` disturbed runs; NaN where one does not reach its end.

        The drive is off by up to `reach`, as much as tolerance or model may make a run wrong: less leads along one way
        through chaos.
        """
        count = min(count, _TOGETHER // max(self.steps, 1))
        parts = np.linspace(-1.0, 1.0, count)
        off = self.held if reach >= self.off else 0.0
        others = off * (2.0 * np.mod(np.arange(count)[:, None] * _EVENLY, 1.0) - 1.0)
        disturbances = [
            _Disturbance(_ENSEMBLE_REACH * float(part), reach * float(part), float(held), float(late))
            for part, (held, late) in zip(parts, others, strict=True)
        ]
        with ThreadPoolExecutor() as pool:
            return list(pool.map(lambda one: self.run(_ENSEMBLE_SHARE, one).amplitude, disturbances))

    @property
    def off_allowed(self) -> float:
        """Distance from the runs of `off_model` up to which a motion is regular, over its amplitude."""
        return _DIVERGED + _GROWN * (self.off + self.held)

    def off_model(self) -> list[_Motion]:
        """Return the motions of a larger drive, and of a smaller one that is late while the grain is held."""
        ends = _Disturbance(drive=self.off, held=self.held), _Disturbance(drive=-self.off, late=self.held)
        return [self.run(_CHECKS[0][0], end, _MOST) for end in ends]

    def run(self, share: float, by: _Disturbance, samples: int = 0) -> _Motion:
        """Return a run with a share of the tolerance and a disturbance."""
        state = self.integration.initial_state()
        self.integration.disturb(state, by.start * self.amplitude)
        table = self.integration.table.copy()
        table[:, SUPPORT] *= 1.0 + by.drive
        if by.held != 0.0 or by.late != 0.0:
            shut = table[:, columns.HEIGHT] <= 2.0 * self.integration.system.radius * (1.0 + _SHUT)
            shut &= table[:, columns.CEILING_VELOCITY] <= 0.0
            table[np.ix_(np.flatnonzero(shut), np.asarray(SUPPORT))] *= 1.0 + by.held
            table[shut, columns.PHASE] -= by.late
        return self._motion(share, state, table, samples)

    def _motion(self, share: float, state: State, table: Array, samples: int) -> _Motion:
        scene, original = self.integration.scene, self.integration
        begin = state.time
        period = max(1.0 / (_PER_PERIOD * scene.frequency_hz), (scene.duration - begin) / _MOST)
        series = sample_series(min(samples, int((scene.duration - begin) / period)))
        limit = min(_FINER * self.steps + 100_000, max(_FINER_LONG * self.steps, original.step_limit))
        finer = Integration(scene, original.fidelity, max(share * original.rtol, 1e-12))
        outcome = finer.advance(state, table, Observation(scene.steady_window, begin, period, series), limit)
        return _Motion(state.amplitude if outcome == Outcome.DONE else float("nan"), series[columns.S_BEAM])


#: Tolerance of the run with contacts of finite duration: only resting grains are integrated.
_RTOL = 1e-4
#: Share of the scene's model error up to which one such run will do: more may be the distance of one draw.
_NEAR = 0.5


def cross_check_with_finite(
    impacts: Integration, amplitude: float, verdict: Verdict, choice: Choice, undamped: float
) -> Verdict:
    """Return the verdict on a reproducible run with instantaneous impacts, what the level leaves out included.

    The error stated for a scene is what impacts change in a motion. Near the end of a branch of motions, and after a
    long transient, the two levels end in different ones: one run with tabulated contacts shows it.
    amplitude: of that run [m]; verdict: on its repetitions; undamped: amplitude of the closed damper [m]. Where the
    amplitude of finite contacts is farther off than half the scene's model error, that motion has to be reproducible as
    well, and the distance is the error if it is the larger one. The error is unknown where that run does not reach its
    end.
    """
    scene, stated = impacts.scene, choice.model_error
    finite = impacts.at_level("finite", min(impacts.rtol, _RTOL))
    state = finite.initial_state()
    outcome = finite.advance(state, finite.table, Observation(scene.steady_window), finite.step_limit)
    if outcome != Outcome.DONE:
        return Verdict(float("nan"), False, (amplitude, amplitude, amplitude))
    beyond = max(abs(amplitude - state.amplitude) - negligible_displacement(scene), 0.0)
    apart, left_out = beyond / max(state.amplitude, 1e-300), finite_error(scene, undamped)
    if apart + left_out <= _NEAR * stated:
        return Verdict(verdict.error + stated, True, None, verdict.change)
    other = judge(finite, state.amplitude, state.steps, left_out, held_error(scene, undamped))
    error = max(stated, apart + left_out + other.error) + verdict.error
    if other.spread is None:
        return Verdict(error, True, None, min(verdict.change, other.change))
    least, median, most = other.spread
    return Verdict(
        error, False, (float(np.fmin(amplitude, least)), median, float(np.fmax(amplitude, most))), other.change
    )
