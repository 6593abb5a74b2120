# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The role of a controller, and the one that selects: hold, selection, range, refusals, step back, search."""

import math
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from atpid_common.parameters import live
from atpid_common.vocabulary import EventKind, Severity
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.drift import DriftAlarm, DriftSettings, ModelCheck, Twin
from atpid_control.loop.hold import (
    NO_HEIGHT,
    OFF_RESONANCE,
    Hold,
    HoldDecision,
    HoldSettings,
    StepBack,
    StepBackMonitor,
)
from atpid_control.loop.protocol import HeightCommand, InlineExecutor, LoopAnswer
from atpid_control.loop.search_run import SearchMode
from atpid_control.selection.protocol import Excitation, HeightSelector, Selection, SelectionError


@dataclass(frozen=True)
class ControlSettings:
    """Settings that may change while the loop runs."""

    hold: HoldSettings
    step_back: StepBack
    drift: DriftSettings
    margin: float = live(
        3.0, "standard deviations of the amplitude the height must be safe for; 0: bare optimum", "-", 0.0, 100.0
    )
    fallback_count: int = live(
        20, "estimates in a row without a height, before the look-up answers where a map is given", "", 1, 10_000
    )


class Fallback:
    """When the method fails or is late the look-up answers in its place or, without a map, the hold.

    Counts, without a clock, the estimates that ask for a height and get none from the method.
    """

    def __init__(self, method: str, selector: HeightSelector | None, count: int) -> None:
        """Take the chosen method's name, what answers in its place (None: nothing does), and after how many."""
        self.selector, self.count = selector, count
        self._method, self._unanswered, self._announced = method, 0, False

    @property
    def active(self) -> bool:
        """Whether the method is out of use until it answers in time again."""
        return self._announced

    def due(self) -> bool:
        """Count an estimate that the method gave no height for; return whether the fallback is to act now."""
        self._unanswered += 1
        return self._announced or self._unanswered >= self.count

    def answered(self, answer: LoopAnswer) -> LoopAnswer:
        """Take a height that the method gave in time; return its answer, with an event where that is new."""
        self._unanswered = 0
        if not self._announced:
            return answer
        self._announced = False
        return replace(
            answer, kind=EventKind.FALLBACK, text=f"{self._method} gives heights in time again", severity=Severity.INFO
        )

    def not_asked(self) -> None:
        """Take an estimate that asks for no height: what was counted is over."""
        self._unanswered = 0

    def announced(self, answer: LoopAnswer, amplitude: float, what: str) -> LoopAnswer:
        """Return the answer that was given in the method's place, with an event the first time; amplitude [m]."""
        if self._announced:
            return answer
        self._announced = True
        text = f"{self._method} has given no height for {self._unanswered} estimates: {what}"
        return replace(answer, kind=EventKind.FALLBACK, text=text, value=amplitude, severity=Severity.ALARM)


#: A ceiling this close to where it was sent is there [m].
_ARRIVED = 2e-3


@dataclass(frozen=True)
class _Computation:
    """A selection in progress."""

    verdict: HoldDecision
    margin: float  # [-]
    result: Future[Selection]
    begun: int  # estimates before it


class Controller(Protocol):
    """Answers each estimate with a command."""

    @property
    def search(self) -> SearchMode | None:
        """Its step search on the running structure; None: it has none."""

    def select_by(
        self, settings: ControlSettings, selector: HeightSelector, fallback: HeightSelector | None = None
    ) -> None:
        """Select by another method from the next estimate on."""

    def answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        """Answer one estimate at `time` since the start [s], the ceiling being at `height` [m] (NaN: unknown)."""

    def on_event(self, kind: str) -> None:
        """Take an event: `rumble` when the beam's response turns irregular, `calm` when that has ended."""

    def configure(self, settings: ControlSettings) -> None:
        """Control by other settings from the next estimate on."""


class SelectingController:
    """Selects a height by the verdict of the hold; otherwise repeats the last command, as a heartbeat.

    While a height is being computed the last command is repeated too. A result that comes when the excitation has
    changed is dropped, and the height selected anew. `search` is its other mode: a step search on the structure, which
    commands the ceiling while it runs.
    """

    def __init__(
        self,
        settings: ControlSettings,
        selector: HeightSelector,
        limits: tuple[float, float],
        twin: Twin | None = None,
        executor: Executor | None = None,
        fallback: HeightSelector | None = None,
    ) -> None:
        """Take the method, and the lowest and highest height [m].

        twin: predicts the beam's amplitude, to be compared with the measured one; None: it is not compared.
        executor: where heights and twin are computed, one call at a time; None: inline. fallback: looks heights up
        where the method fails or is late; None: the ceiling is held.
        """
        self._computing = executor or InlineExecutor()
        self._settings, self._limits, self.search = settings, limits, SearchMode(limits)
        self._model_check = ModelCheck(twin, DriftAlarm(settings.drift), self._computing) if twin is not None else None
        self._estimates = 0
        self._command = HeightCommand()
        self.select_by(settings, selector, fallback)

    def select_by(
        self, settings: ControlSettings, selector: HeightSelector, fallback: HeightSelector | None = None
    ) -> None:
        """Select by this method from the next estimate on; a running search ends. See `__init__`.

        The ceiling stays until a height is selected, and the commands' sequence numbers go on.
        """
        self.search.end("another method was chosen")
        # a height that is only looked up comes with the answer, in real time as in lockstep
        self._executor = self._computing if selector.simulates else InlineExecutor()
        self._settings, self._selector, self._hold = settings, selector, Hold(settings.hold)
        self._step_back = StepBackMonitor(settings.step_back, self._limits[0])
        self._fallback = Fallback(selector.method, fallback, settings.fallback_count)
        self._computation: _Computation | None = None
        self._expected = math.nan  # amplitude of the beam at the height selected [m]
        self._command = HeightCommand(sequence=self._command.sequence, method=selector.method)
        self._refusal = ""
        self._of_no_use = False  # whether the last selection reported that the damper is of no use
        if self._model_check is not None:
            self._model_check.restart()

    def configure(self, settings: ControlSettings) -> None:
        """See `Controller.configure`."""
        before, self._settings = self._settings, settings
        another_margin = settings.margin != before.margin
        if another_margin or settings.hold != before.hold:
            self._hold.configure(settings.hold, select_anew=another_margin and self._command.sequence > 0)
        self._step_back.settings, self._fallback.count = settings.step_back, settings.fallback_count
        if self._model_check is not None and settings.drift != before.drift:
            self._model_check.alarm = DriftAlarm(settings.drift)

    def answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        """See `Controller.answer`."""
        return self.search.replaced(time, height, self._answer(time, estimate, height))

    def _answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        self._estimates += 1
        verdict = self._hold.judge(estimate)
        standing = abs(height - self._command.height) <= _ARRIVED
        step = self._step_back.watch(estimate.beam_amplitude, self._expected, standing)
        computed = self._computed(verdict, estimate, height)
        if computed is not None:
            return self._selected(computed, estimate)
        if step:
            return self._stepped_back()
        replaced = self._replaced(verdict, estimate, height)
        if replaced is not None:
            return replaced
        if verdict.refused:
            self._command = replace(self._command, reason=verdict.reason)
            return self._refuse(verdict.reason, verdict.reason, estimate)
        self._refusal = ""
        if self._computation is not None:
            self._command = replace(self._command, reason="computing")
            return LoopAnswer(self._command)
        self._command = replace(self._command, reason=verdict.reason)
        return self._checked(time, estimate, height)

    def on_event(self, kind: str) -> None:
        """See `Controller.on_event`."""
        if not self.search.crosses(kind):
            self._step_back.on_event(kind)

    def _computed(self, verdict: HoldDecision, estimate: Estimate, height: float) -> _Computation | None:
        """Begin a selection where the verdict asks for one; return the one that is done and still valid, if any."""
        done = self._take_done(estimate)
        outdated = done is not None and not self._hold.inside(estimate, done.verdict.amplitude, done.verdict.frequency)
        if verdict.select and self._computation is None and (done is None or outdated):
            margin = self._settings.margin
            result = self._executor.submit(_select, self._selector, estimate, margin, height)
            self._computation = _Computation(verdict, margin, result, self._estimates)
        return done or self._take_done(estimate)

    def _take_done(self, estimate: Estimate) -> _Computation | None:
        """Return a selection that is done; drop it where excitation or margin have changed meanwhile.

        An estimate that must not be acted on is skipped: the result waits for the next one.
        """
        done = self._computation
        if done is None or not done.result.done() or self._hold.reason_to_reject(estimate):
            return None
        self._computation = None
        error = done.result.exception()
        if error is not None and not isinstance(error, SelectionError):
            raise error  # a defect, also where its result is not needed any more
        late = self._fallback.selector is not None and self._estimates - done.begun >= self._fallback.count
        valid = (
            not late
            and done.margin == self._settings.margin
            and self._hold.agrees(done.verdict.amplitude, estimate, done.verdict.frequency)
        )
        return done if valid else None

    def _replaced(self, verdict: HoldDecision, estimate: Estimate, height: float) -> LoopAnswer | None:
        """Return the answer in place of a method that has given no height for too long; None: it is not needed."""
        asked = verdict.select or verdict.reason == NO_HEIGHT
        if not asked:
            self._fallback.not_asked()
        if not asked or not self._fallback.due():
            return None
        selector, amplitude = self._fallback.selector, estimate.amplitude
        if selector is None:
            # a refusal was reported already; a method that is only late was not
            announce = verdict.select and not self._fallback.active
            held = LoopAnswer(self._command)
            return self._fallback.announced(held, amplitude, "the ceiling is held") if announce else None
        try:
            selection = _select(selector, estimate, self._settings.margin, height)
        except SelectionError:
            return None  # held, as without a fallback
        taken = HoldDecision.to_select(f"{self._selector.method} gave no height", estimate)
        return self._fallback.announced(self._taken(selection, taken), amplitude, "heights are looked up")

    def _checked(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        """Compare the beam with the twin where excitation, ceiling and beam have settled."""
        if self._model_check is None or not self._step_back.settled or estimate.quality != Quality.STEADY:
            return LoopAnswer(self._command)
        drift = self._model_check.check(time, (estimate.amplitude, estimate.frequency), height, estimate.beam_amplitude)
        if math.isnan(self._command.predicted_amplitude):
            # stepped back, at the end of the range, or by a method without a prediction
            self._command = replace(self._command, predicted_amplitude=self._model_check.expected)
        return (
            LoopAnswer(self._command, EventKind.DRIFT, drift, estimate.beam_amplitude, Severity.ALARM)
            if drift
            else LoopAnswer(self._command)
        )

    def _restart(self) -> None:
        """Restart the monitoring: another height was commanded."""
        self._step_back.interrupt()
        if self._model_check is not None:
            self._model_check.restart()

    def _stepped_back(self) -> LoopAnswer:
        before = self._command.height
        height = self._step_back.lower(before, self._hold.acted_amplitude)
        self._restart()
        self._command = replace(
            self._command,
            sequence=self._command.sequence + 1,
            height=height,
            predicted_amplitude=math.nan,
            reason="rumble: stepped back",
        )
        text = f"the beam rumbles: the ceiling steps back from {before:.4f} to {height:.4f} m"
        return LoopAnswer(self._command, EventKind.STEP_BACK, text, height)

    def _selected(self, computed: _Computation, estimate: Estimate) -> LoopAnswer:
        """Command the height that was computed, or report why there is none."""
        verdict = computed.verdict
        try:
            selection = computed.result.result()
        except SelectionError as error:
            self._hold.failed(verdict.amplitude, verdict.frequency)
            self._command = replace(self._command, reason=NO_HEIGHT)
            return self._refuse(NO_HEIGHT, str(error), estimate)
        return self._fallback.answered(self._taken(selection, verdict))

    def _taken(self, selection: Selection, verdict: HoldDecision) -> LoopAnswer:
        """Command a height that was selected."""
        self._hold.acted(verdict.amplitude, verdict.frequency)
        self._restart()
        self._command = self._limited(selection, verdict)
        self._expected = self._command.predicted_amplitude
        self._refusal = ""
        announced, self._of_no_use = self._of_no_use, bool(selection.no_use)
        if selection.no_use and not announced:
            return LoopAnswer(self._command, EventKind.NO_USE, selection.no_use, verdict.amplitude, Severity.INFO)
        if selection.late:
            return LoopAnswer(self._command, EventKind.SLOW, f"{selection.method}: {selection.note}", selection.wall_s)
        return LoopAnswer(self._command)

    def _limited(self, selection: Selection, verdict: HoldDecision) -> HeightCommand:
        low, high = self._limits
        allowed = self._step_back.allowed(selection.height, verdict.amplitude)
        height = min(max(allowed, low), high)
        inside = height == allowed
        reason = verdict.reason if allowed == selection.height else f"{verdict.reason}, below what rumbled"
        if selection.no_use:
            reason = f"{verdict.reason}: {selection.no_use}"
        elif selection.note:
            reason = f"{reason} ({selection.note})"
        return HeightCommand(
            sequence=self._command.sequence + 1,
            height=height,
            excitation_amplitude=verdict.amplitude,
            predicted_amplitude=selection.beam_amplitude if height == selection.height else math.nan,
            method=selection.method,
            reason=reason if inside else f"{reason}, at the end of the ceiling's range",
        )

    def _refuse(self, key: str, text: str, estimate: Estimate) -> LoopAnswer:
        """Report a refusal once: again only after an estimate has been accepted or the reason has changed."""
        reported, self._refusal = self._refusal == key, key
        if reported:
            return LoopAnswer(self._command)
        value = estimate.frequency if key == OFF_RESONANCE else estimate.amplitude
        return LoopAnswer(self._command, EventKind.REFUSED, f"the ceiling stays: {text}", value)


class ProfileController:
    """Sends the heights a scene prescribes, for scenes whose ceiling no controller moves."""

    search = None

    def select_by(
        self, settings: ControlSettings, selector: HeightSelector, fallback: HeightSelector | None = None
    ) -> None:
        """Nothing moves this ceiling but the scene."""

    def on_event(self, kind: str) -> None:
        """Nothing moves this ceiling but the scene."""

    def configure(self, settings: ControlSettings) -> None:
        """Nothing moves this ceiling but the scene."""

    def __init__(self, heights: tuple[tuple[float, float], ...]) -> None:
        """Take the points (t [s], h [m]), straight in between."""
        self._times, self._heights = zip(*heights, strict=True)
        self._command = HeightCommand(method="fixed")

    def answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        """See `Controller.answer`."""
        del estimate, height
        target = float(np.interp(time, self._times, self._heights))
        if target != self._command.height:
            self._command = replace(
                self._command, sequence=self._command.sequence + 1, height=target, reason="prescribed by the scene"
            )
        return LoopAnswer(self._command)


def _select(selector: HeightSelector, estimate: Estimate, margin: float, height: float) -> Selection:
    """Return the height for an estimate; raise SelectionError where there is none."""
    excitation = Excitation(estimate.amplitude, estimate.amplitude_std, estimate.frequency)
    return selector.select(excitation, margin, height)
