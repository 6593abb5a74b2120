# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The step search in the control loop, a mode of the controller: it commands the ceiling while it runs."""

import math
from dataclasses import replace

import numpy as np

from atpid_common.vocabulary import EventKind
from atpid_control.loop.protocol import HeightCommand, LoopAnswer
from atpid_control.selection.search import Plan, SearchError, StepSearch
from atpid_sim.system import Array

#: Share of the dwell before the beam is watched, and length of one window, the second of which ends with the dwell.
_BEFORE, _WINDOW = 0.2, 0.4
#: Least dwell [s]: a window is then two periods of the bench.
_LEAST_DWELL = 1.0
#: The beam has settled where two windows agree to this share of the amplitude [-].
_SETTLED = 0.005
#: A beam that has not settled after so many windows is irregular: its largest amplitude in the last two counts.
_MOST_WINDOWS = 14
#: A height is worse than the best where the amplitude is larger by more than this [-], twice what settling leaves.
_WORSE = 0.01
#: A ceiling this close to its target has arrived [m], ten times what the motor resolves.
_ARRIVED = 5e-3
#: Time limit for the ceiling to arrive and for the first block of the beam [s].
_TIMEOUT = 60.0


class SearchRun:
    """One search: moves, waits, watches, all by the data's stamps."""

    def __init__(self, plan: Plan) -> None:
        """Begin at the plan's lowest height; raise SearchError for a dwell that is too short."""
        if plan.dwell < _LEAST_DWELL:
            raise SearchError(f"dwell: given {plan.dwell:g} s; allowed is at least {_LEAST_DWELL:g} s")
        self._plan, self.search = plan, StepSearch(plan, _WORSE)
        self._sent_at = self._arrived_at = math.nan
        self.height = math.nan  # where the ceiling is [m]
        self.amplitude = math.nan  # half peak-to-peak of the beam observed last [m], NaN: none yet
        self.message = ""  # how it ended, empty while it runs
        self._window: list[tuple[float, float]] = []  # (lowest, highest) of each block in the present window [m]
        self._amplitudes: list[float] = []  # of the windows at this height [m]

    @property
    def done(self) -> bool:
        """Whether the search has ended, well or not."""
        return bool(self.message)

    @property
    def success(self) -> bool:
        """Whether it ended with a height."""
        return self.done and self.search.done

    def watch(self, time: float, beam: Array) -> None:
        """Take a block of the beam's displacement (n,) [m] that ended at `time` [s]; NaN: not measured."""
        if time >= self._arrived_at + _BEFORE * self._plan.dwell:
            self._window.append((float(np.min(beam)), float(np.max(beam))))

    def step(self, time: float, height: float) -> None:
        """Go on, at `time` [s] with the ceiling at `height` [m]."""
        self.height = height
        if self.done:
            return
        if math.isnan(self._sent_at):
            self._sent_at = time
        if math.isnan(self._arrived_at):
            if abs(height - self.search.target) <= _ARRIVED:
                self._arrived_at = time
            elif time > self._sent_at + _TIMEOUT:
                target = f"{self.search.target:g} m in {_TIMEOUT:g} s"
                self.stop(f"the ceiling has not reached {target}; it is at {height:g} m")
            return
        end = self._arrived_at + (_BEFORE + _WINDOW * (1 + len(self._amplitudes))) * self._plan.dwell
        # the first blocks may still be missing
        if time >= end and (self._window or time > self._arrived_at + _TIMEOUT):
            self._end_window(time)

    def stop(self, message: str) -> None:
        """End without a result."""
        if not self.done:
            self.message = message

    def _end_window(self, time: float) -> None:
        lows, highs = zip(*self._window, strict=True) if self._window else ((math.nan,), (math.nan,))
        amplitude = 0.5 * (max(highs) - min(lows)) if np.isfinite([*lows, *highs]).all() else math.nan
        self._window = []
        before = self._amplitudes[-1] if self._amplitudes else math.nan
        self._amplitudes.append(amplitude)
        # after a change of height the beam grows or falls for seconds: what it does meanwhile is no measure of a height
        if math.isnan(amplitude) or abs(amplitude - before) <= _SETTLED * amplitude:
            self._observe(time, amplitude)
        elif len(self._amplitudes) == _MOST_WINDOWS:
            self._observe(time, max(amplitude, before))

    def _observe(self, time: float, amplitude: float) -> None:
        self.amplitude = amplitude
        try:
            self.search.observe(amplitude)
        except SearchError as error:
            self.stop(str(error))
            return
        self._amplitudes, self._arrived_at, self._sent_at = [], math.nan, time
        if self.search.done:
            self.message = f"best height {self.search.target:.4f} m after {self.search.iterations} heights"


class SearchMode:
    """What a search does to a controller's commands; the height it finds is kept until another is selected.

    `run` is the search that runs or ran last; None: none, or a height was selected since.
    """

    def __init__(self, limits: tuple[float, float]) -> None:
        """Take the ceiling's range [m]."""
        self._limits = limits
        self.run: SearchRun | None = None
        self._selected = 0  # sequence number of the selection that the search replaced
        self._issued = 0  # commands of searches
        self._target = self._held_at = math.nan

    def begin(self, plan: Plan) -> SearchRun:
        """Start a search; raise SearchError where one runs already or the plan leaves the ceiling's range."""
        if self.run is not None and not self.run.done:
            raise SearchError("a search is running; cancel it first")
        low, high = self._limits
        if plan.lowest < low or plan.highest > high:
            raise SearchError(
                f"limits: given {plan.lowest:g} to {plan.highest:g} m; allowed is the ceiling's {low:g} to {high:g} m"
            )
        self.run, self._target = SearchRun(plan), math.nan
        return self.run

    def end(self, reason: str) -> None:
        """End a search that runs, and give up the height that the last one found."""
        if self.run is not None:
            self.run.stop(reason)
            self.run, self._target = None, math.nan

    def watch(self, time: float, beam: Array) -> None:
        """Show a running search a block of the beam (n,) [m] that ended at `time` [s]."""
        if self.run is not None and not self.run.done:
            self.run.watch(time, beam)

    def crosses(self, kind: str) -> bool:
        """Whether an event belongs to a running search, which crosses rumble."""
        return kind == EventKind.RUMBLE and self.run is not None and not self.run.done

    def replaced(self, time: float, height: float, answer: LoopAnswer) -> LoopAnswer:
        """Return the answer with the search's command in place of the selection's, where there is a search.

        The search's commands are counted in: a sequence number is never used twice.
        """
        command = answer.command
        if self.run is not None and math.isnan(self._target):
            self._selected = command.sequence
        if self.run is not None and command.sequence != self._selected:
            self.end("the excitation changed, so another height was selected")
        if self.run is not None:
            self.run.step(time, height)
            command = self._searching(self.run, command, height)
        return replace(answer, command=replace(command, sequence=command.sequence + self._issued))

    def _searching(self, run: SearchRun, command: HeightCommand, height: float) -> HeightCommand:
        target = run.search.target if not run.done or run.success else self._held_height(height)
        if target != self._target:
            self._target, self._issued = target, self._issued + 1
        reason = run.message or f"search: height {run.search.iterations + 1}"
        return replace(command, height=target, predicted_amplitude=math.nan, method="search", reason=reason)

    def _held_height(self, height: float) -> float:
        """Where a search that ended without a result leaves the ceiling: where it stood then [m]."""
        if math.isnan(self._held_at) or self._held_at != self._target:
            self._held_at = height
        return self._held_at
