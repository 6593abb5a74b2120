# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steady motions that a scene comes to at many heights of its ceiling.

At some heights the scene is run as it is. Where the runs at three heights settle, and all on the way is at the middle
one what lies between the other two, the motions of all heights between these are solved for, each from its neighbours
(`engine.neighbour_run`); the middle and the far one have to come out as their own runs have it. Elsewhere the heights
between are halved, down to each on its own. So no height gets the motion of a neighbour to which its own run does not
lead: which of several motions a system ends in depends on its start (docs/steady.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import Document
from atpid_dynamics.engine.neighbour_run import solve_along
from atpid_dynamics.heights import HeightTables, ends_alike, tables_at
from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.periodic.return_map import Conditions, passage, table_of
from atpid_sim.periodic.solve import least_size, size_of
from atpid_sim.periodic.steady import still_from
from atpid_sim.scene import Scene, SceneError
from atpid_sim.simulation.batch import HERE, Batch, Progress, Record, Workers
from atpid_sim.simulation.fidelity import Choice, choose
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: Heights of a job: large enough that few of them have to be run, small enough that workers end together.
_CHUNK = 128
#: Longest period looked for.
_LONGEST = 4
#: Distance of two strobes, relative to the motion's size, below which a run may be about to repeat itself, and the
#: factor by which they have come nearer in the last quarter of the run, if they are not the same already.
_NEAR, _NEARER, _SAME = 0.03, 0.8, 1e-5
#: How far a run may be from the motion solved for, and the strobes of a run from those between its neighbours'.
_FAR, _BETWEEN = 0.05, 0.05
#: Displacements in the strobes: velocities jump where a contact happens to lie at the strobe.
_PLACES = (0, 2)
#: Length of Newton's last step over the integrator's tolerance; how much amplitudes of the same motion may differ.
_CLOSE, _ALIKE = 0.3, 3.0
#: Largest modulus of the multipliers of a motion that counts as stable, since it comes of plain differences.
_STABLE = 0.995


class Way(IntEnum):
    """How the amplitude at a height was found."""

    NEIGHBOUR = 0  # the steady motion, solved for from that of a neighbour
    OWN = 1  # the steady motion, solved for from the end of the scene's run
    UNSETTLED = 2  # that of the scene's run in its steady window: it had not come to repeat itself by its end
    FAILED = 3  # none: the run did not reach its end


@dataclass(frozen=True)
class HeightSweep:
    """What a scene comes to at heights (n,)."""

    heights: Array  # [m]
    amplitudes: Array  # half peak-to-peak of the beam [m]
    errors: Array  # relative, of the amplitude of a steady motion; NaN where it is none
    multipliers: Array  # largest modulus, from simple differences at a neighbour; NaN without a steady motion
    periods: NDArray[np.int64]  # of the support after which the motion repeats itself; 0 where it does not
    ways: NDArray[np.int64]  # values of `Way`
    fidelity: str

    @property
    def sentence(self) -> str:
        """How the heights were found, and the lowest amplitude of a steady motion."""
        count = [int(np.count_nonzero(self.ways == way)) for way in Way]
        steady = count[Way.NEIGHBOUR] + count[Way.OWN]
        said = (
            f"{steady} of {len(self.ways)} heights with a steady motion, {count[Way.OWN]} of them found by the scene's "
            f"run there; {count[Way.UNSETTLED]} that have not settled by the scene's end"
        )
        if count[Way.FAILED]:
            said += f", {count[Way.FAILED]} without a run to the end"
        if not steady:
            return said
        best = int(np.argmin(np.where(self.periods > 0, self.amplitudes, math.inf)))
        return f"{said}; the lowest steady amplitude {self.amplitudes[best]:.6g} m at {self.heights[best]:.5g} m"

    @classmethod
    def from_plain(cls, plain: Document) -> HeightSweep:
        """Return what a journal has, by the names of the fields."""
        arrays: Document = {name: np.array(plain[name]) for name in ARRAYS}
        return cls(**arrays, fidelity=str(plain["fidelity"]))


#: Fields of `HeightSweep` that have a value for each height.
ARRAYS = [one.name for one in fields(HeightSweep) if one.name != "fidelity"]


def over_heights(
    scenes: Sequence[Scene],
    heights: Array,
    fidelity: str = "auto",
    rtol: float | None = None,
    workers: Workers = HERE,
    progress: Progress | None = None,
    journal: Path | None = None,
) -> list[HeightSweep]:
    """Return what each of the scenes comes to at heights (n,), rising [m], to which its ceiling goes last.

    fidelity, rtol: as in `simulate`; progress: called with the number of heights done; journal: of what is done, which
    the caller removes. Raises SceneError where excitation or ceiling change until the steady window or a controller
    moves the ceiling, ValueError for an unknown fidelity or heights that do not rise, ClusterError, JournalError.
    """
    heights = np.asarray(heights, dtype=float)
    if len(heights) < 1 or not (np.diff(heights) > 0.0).all():
        raise ValueError(f"heights: given {heights.tolist()}; allowed: at least one, each above the one before")
    rows = [_Row(scene, heights, choose(scene, fidelity), rtol) for scene in scenes]
    begins = range(0, len(heights), _CHUNK)
    # from the largest heights down: irregular motions, whose jobs take longest, mostly lie there
    jobs = [(k, begin) for k in range(len(scenes)) for begin in reversed(begins)]
    record = None
    if journal is not None:
        purpose = {"heights": heights.tolist(), "scenes": [scene.to_mapping() for scene in scenes]}
        purpose["settings"] = [_CHUNK, rtol, fidelity]
        record = Record[tuple[int, int], HeightSweep](journal, purpose, lambda job: job, vars, HeightSweep.from_plain)
    report = progress or (lambda _: None)
    each, most = min(_CHUNK, len(heights)), len(scenes) * len(heights)
    done = Batch(partial(_job, rows), jobs).run(workers, lambda count: report(min(each * count, most)), record)
    return [_joined(done[k * len(begins) : (k + 1) * len(begins)][::-1]) for k in range(len(scenes))]


def _job(rows: Sequence[_Row], job: tuple[int, int]) -> HeightSweep:
    return rows[job[0]].part(job[1])


def _joined(parts: Sequence[HeightSweep]) -> HeightSweep:
    arrays: Document = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS}
    return HeightSweep(**arrays, fidelity=parts[0].fidelity)


@dataclass(frozen=True)
class _Row:
    """One scene over all heights."""

    scene: Scene
    heights: Array
    choice: Choice
    rtol: float | None

    @cached_property
    def tables(self) -> HeightTables:
        """Drive tables of all heights."""
        return tables_at(self.scene, self.heights)

    @cached_property
    def integration(self) -> Integration:
        """The scene's integration at the largest height."""
        return Integration(self.tables.widest, self.choice.fidelity, self.rtol, table=self.tables.tables[-1])

    def part(self, begin: int) -> HeightSweep:
        """Return what the scene comes to at the heights of one job."""
        return _Part(self, slice(begin, begin + _CHUNK)).found()


@dataclass(frozen=True)
class _Motion:
    """A steady motion, solved for."""

    phase: float  # of the section
    section: Array
    scale: Array
    amplitude: float
    periods: int


class _Part:
    """The heights of one job."""

    def __init__(self, row: _Row, part: slice) -> None:
        widest, tables, self.common = row.tables
        self.heights, self.tables, self.integration = row.heights[part], tables[part], row.integration
        asked = self.integration.rtol
        self.close, self.known = _CLOSE * asked, row.choice.model_error + asked
        self.frequency, window = widest.frequency_hz, widest.steady_window
        still = still_from(widest)
        if not widest.excitation.is_tone or still >= window[0]:
            raise SceneError(
                f"steady_window: given {window[0]:g} s with changes until {still:g} s; allowed for steady motions: a "
                "tone, and a ceiling, that are constant before it"
            )
        self.support = widest.excitation.amplitude_points[-1][1]
        # strobes of the scene's run, from its last kink on
        self.strobes = still, 1.0 / self.frequency, max(0, int((widest.duration - still) * self.frequency))
        last = self.tables[0, -1]
        turned = last[columns.PHASE] + last[columns.OMEGA] * (last[columns.END] - last[columns.START])
        self.phase = turned / (2.0 * math.pi) % 1.0
        count = len(self.heights)
        self.series = np.full((count, self.strobes[2], 3), np.nan)
        self.periods = np.full(count, -1)  # of the scene's own run; 0: irregular; -1: not run
        self.ends: dict[int, State] = {}
        self.motions: dict[int, _Motion | None] = {}
        found, errors, multipliers = np.full((3, count), np.nan)
        none, ways = np.zeros(count, dtype=np.int64), np.full(count, Way.FAILED, dtype=np.int64)
        self.result = HeightSweep(self.heights, found, errors, multipliers, none, ways, row.choice.fidelity)

    def found(self) -> HeightSweep:
        """Run where that is needed, solve for the rest."""
        last = len(self.heights) - 1
        self._run([0, last // 2, last])
        pending = [(0, last)]
        while pending:
            halved: list[tuple[int, int]] = []
            missing: list[int] = []
            for begin, end in pending:
                middle = (begin + end) // 2
                if end - begin < 2:
                    continue
                if not self.periods[[begin, middle, end]].any():
                    missing += range(begin, end)
                elif not self._solved(begin, middle, end):
                    halved += [(begin, middle), (middle, end)]
            missing += [(begin + end) // 2 for begin, end in halved]
            self._run(missing)
            pending = halved
        for place in np.flatnonzero((self.periods > 0) & (self.result.ways == Way.UNSETTLED)).tolist():
            self._own(place)
        return self.result

    def _run(self, wanted: Sequence[int]) -> None:
        """Run the scene at heights by their places, and look whether it settles."""
        places = np.array(sorted({place for place in wanted if self.periods[place] < 0}), dtype=int)
        if not len(places):
            return
        first, (still, period, count) = self.integration.initial_state().without_ledger(), self.strobes
        series = np.zeros((len(places), columns.SAMPLE_ROWS, count))
        common = min(self.common, int(np.searchsorted(self.tables[0, :, columns.END], still, side="right")))
        y, n, outcomes = ends_alike(self.integration, first, self.tables[places], common, (still, period), series)
        amplitudes, done = 0.5 * (y[:, columns.HIGHEST] - y[:, columns.LOWEST]), outcomes == Outcome.DONE
        pace, result = 2.0 * math.pi * self.frequency, self.result
        seen = series[:, [columns.S_BEAM, columns.S_VELOCITY, columns.S_GRAIN]].transpose(0, 2, 1)
        self.series[places] = seen * np.array([1.0, 1.0 / pace, 1.0])
        least = least_size(self.integration, Conditions(self.support, self.frequency, 0.0))
        sizes = np.maximum(amplitudes, least)
        self.periods[places] = np.where(done, _repeating(self.series[places] / sizes[:, None, None]), 0)
        result.amplitudes[places[done]], result.ways[places[done]] = amplitudes[done], Way.UNSETTLED
        self.ends.update((int(place), State(y[k], n[k])) for k, place in enumerate(places))

    def _solved(self, begin: int, middle: int, end: int) -> bool:
        """Solve for the motions from begin to end, if the three runs are alike; return whether all was found."""
        if end - begin < 3:
            return False
        motion, *others = own = [self._own(place) for place in (begin, middle, end)]
        if motion is None or any(one is None or one.periods != motion.periods for one in own):
            return False
        share = (self.heights[middle] - self.heights[begin]) / (self.heights[end] - self.heights[begin])
        first, second, third = self.series[[begin, middle, end]][:, :, _PLACES]
        if not np.abs(second - (1.0 - share) * first - share * third).max() <= _BETWEEN * motion.scale[0]:
            return False
        sections, solved = self._solve(motion, self.heights[begin : end + 1])
        if len(sections) <= end - begin or solved[2].max() >= _STABLE:
            return False
        for place, one in zip((middle, end), others, strict=True):
            amplitude = solved[0, place - begin]
            if one is None or abs(one.amplitude - amplitude) > _ALIKE * self.known * amplitude:
                return False
        for place in range(begin, end + 1):
            if self.periods[place] < 0:
                self._enter(place, solved[:, place - begin], motion.periods, Way.NEIGHBOUR)
        return True

    def _own(self, place: int) -> _Motion | None:
        """Return the steady motion that the scene's own run comes to at a height; None where none is near its end."""
        if place not in self.motions:
            seen = int(self.periods[place])
            fewer = (self._own_motion(place, k) for k in range(1, seen + 1) if seen % k == 0)
            self.motions[place] = next((motion for motion in fewer if motion is not None), None)
        return self.motions[place]

    def _own_motion(self, place: int, periods: int) -> _Motion | None:
        """Return the stable motion of so many periods next to the end of the scene's run, if there is one."""
        conditions = Conditions(self.support, self.frequency, float(self.heights[place]))
        try:
            phase, section = passage(self.integration, conditions, self.ends[place], self.phase, periods)
        except NumericalFailure:
            return None
        scale = size_of(self.integration, float(self.result.amplitudes[place]), conditions)
        near = _Motion(phase, section, scale, math.nan, periods)
        sections, solved = self._solve(near, self.heights[place : place + 1])
        if not len(sections) or solved[2, 0] >= _STABLE or np.abs((sections[0] - section) / scale).max() > _FAR:
            return None
        self._enter(place, solved[:, 0], periods, Way.OWN)
        return _Motion(phase, sections[0], scale, float(solved[0, 0]), periods)

    def _solve(self, near: _Motion, heights: Array) -> tuple[Array, Array]:
        """Return motions (k, d) and what is known of them (3, k) at heights, or at those before one without."""
        conditions = Conditions(self.support, self.frequency, float(heights[0]))
        table = table_of(conditions, near.phase, near.periods / self.frequency)
        places = self.integration.sections
        sections, solved = np.empty((len(heights), len(near.section))), np.empty((3, len(heights)))
        begin = near.section, near.scale, self.close, self.integration.step_limit
        try:
            count = solve_along(self.integration.kernel_inputs, table, places, heights, *begin, sections, solved)
        except np.linalg.LinAlgError:  # a multiplier of exactly 1
            count = 0
        return sections[:count], solved[:, :count]

    def _enter(self, place: int, solved: Array, periods: int, way: Way) -> None:
        result = self.result
        result.amplitudes[place], result.errors[place] = solved[0], solved[1] + self.known
        result.multipliers[place], result.periods[place], result.ways[place] = solved[2], periods, way


def _repeating(series: Array) -> NDArray[np.int64]:
    """Return after how many periods runs are about to repeat themselves, 0 where they are not.

    series (runs, strobes, k): of each run, in units of its size.
    """
    found, quarter = np.zeros(len(series), dtype=np.int64), series.shape[1] // 4
    for periods in range(min(_LONGEST, quarter // 2), 0, -1):
        last = _moved(series[:, -quarter - periods :], periods)
        near = np.flatnonzero(last <= _NEAR)
        earlier = _moved(series[near, -2 * quarter - periods : -quarter], periods)
        found[near[(last[near] <= _NEARER * earlier) | (last[near] <= _SAME)]] = periods
    return found


def _moved(series: Array, periods: int) -> Array:
    """Return the largest change (runs,) of a series (runs, strobes, k) over so many periods."""
    return np.asarray(np.abs(series[:, periods:] - series[:, :-periods]).max(axis=(1, 2)))
