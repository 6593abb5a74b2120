# SPDX-License-Identifier: Apache-2.0
"""From each estimate to one command: hold, selection, the ceiling's range, refusals said once, the step back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from atpid_control.hold import OFF_RESONANCE, Estimate, Hold, Quality, Verdict
from atpid_control.selection.protocol import HeightSelector, Selection, SelectionError
from atpid_control.step_back import Retreat, StepBack
from atpid_control.watch.reality import RealityCheck

#: A ceiling this close to where it was sent is there [m].
_ARRIVED = 2e-3

#: Severities of an Event.
WARNING, ALARM = 1, 2


@dataclass(frozen=True)
class Command:
    """What a CeilingCommand says, without its header."""

    sequence: int = 0
    height: float = math.nan
    excitation_amplitude: float = math.nan
    predicted_amplitude: float = math.nan
    method: str = ""
    reason: str = "no estimate yet"


@dataclass(frozen=True)
class Answer:
    """The command that answers one estimate and, where something has to be said, its kind, text and quantity."""

    command: Command
    kind: str = ""  # refused, step_back or drift; empty: nothing to say
    text: str = ""
    value: float = math.nan
    severity: int = WARNING


class Controller(Protocol):
    """What answers each estimate."""

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """Answer one estimate at `time` since the start [s], the ceiling being at `height` [m] (NaN: unknown)."""
        ...

    def hear(self, kind: str) -> None:
        """Take note of an event: `rumble` when the beam's response turns irregular, `calm` when that has ended."""
        ...


class SelectingController:
    """Selects a height when the hold says so; otherwise repeats the last command, which is how it shows to be alive."""

    def __init__(
        self,
        hold: Hold,
        selector: HeightSelector,
        limits: tuple[float, float],
        margin: float,
        step_back: StepBack,
        reality: RealityCheck | None = None,
    ) -> None:
        """Take the hold, the method, the lowest and highest height [m], the margin in standard deviations [-].

        reality: holds what the beam does against what it should; None: nothing does.
        """
        self._hold, self._selector, self._limits, self._margin = hold, selector, limits, margin
        self._retreat, self._reality = Retreat(step_back, limits[0]), reality
        self._expected = math.nan  # amplitude of the beam at the height selected [m]
        self._command = Command(method=selector.method)
        self._refusal = ""

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """See `Controller.answer`."""
        verdict = self._hold.judge(estimate)
        standing = abs(height - self._command.height) <= _ARRIVED
        step = self._retreat.watch(estimate.beam_amplitude, self._expected, standing)
        if verdict.select:
            return self._select(verdict, estimate, height)
        if step:
            return self._stepped_back()
        self._command = replace(self._command, reason=verdict.reason)
        if verdict.refused:
            return self._refuse(verdict.reason, verdict.reason, estimate)
        self._refusal = ""
        return self._checked(time, estimate, height)

    def hear(self, kind: str) -> None:
        """See `Controller.hear`."""
        self._retreat.hear(kind)

    def _checked(self, time: float, estimate: Estimate, height: float) -> Answer:
        """Hold the beam against the twin where excitation, ceiling and beam have settled."""
        if self._reality is None or not self._retreat.settled or estimate.quality != Quality.STEADY:
            return Answer(self._command)
        said = self._reality.check(time, (estimate.amplitude, estimate.frequency), height, estimate.beam_amplitude)
        if math.isnan(self._command.predicted_amplitude):
            # stepped back, at the end of the range, or a method that does not know
            self._command = replace(self._command, predicted_amplitude=self._reality.expected)
        return Answer(self._command, "drift", said, estimate.beam_amplitude, ALARM) if said else Answer(self._command)

    def _restart(self) -> None:
        """Take note of another height: what was seen at the last one tells nothing of it."""
        self._retreat.interrupt()
        if self._reality is not None:
            self._reality.restart()

    def _stepped_back(self) -> Answer:
        before = self._command.height
        height = self._retreat.lower(before, self._hold.acted_amplitude)
        self._restart()
        self._command = replace(
            self._command,
            sequence=self._command.sequence + 1,
            height=height,
            predicted_amplitude=math.nan,
            reason="rumble: stepped back",
        )
        text = f"the beam rumbles: the ceiling steps back from {before:.4f} to {height:.4f} m"
        return Answer(self._command, "step_back", text, height)

    def _select(self, verdict: Verdict, estimate: Estimate, height: float) -> Answer:
        try:
            selection = self._selector.select(
                verdict.amplitude, verdict.amplitude_std, estimate.frequency, margin=self._margin, height=height
            )
        except SelectionError as error:
            self._hold.failed(verdict.amplitude)
            reason = "no height for this amplitude"
            self._command = replace(self._command, reason=reason)
            return self._refuse(reason, str(error), estimate)
        self._hold.acted(verdict.amplitude)
        self._restart()
        self._command = self._limited(selection, verdict)
        self._expected = self._command.predicted_amplitude
        self._refusal = ""
        return Answer(self._command)

    def _limited(self, selection: Selection, verdict: Verdict) -> Command:
        low, high = self._limits
        wanted = self._retreat.allowed(selection.height, verdict.amplitude)
        height = min(max(wanted, low), high)
        inside = height == wanted
        reason = verdict.reason if wanted == selection.height else f"{verdict.reason}, below what rumbled"
        return Command(
            sequence=self._command.sequence + 1,
            height=height,
            excitation_amplitude=verdict.amplitude,
            predicted_amplitude=selection.beam_amplitude if height == selection.height else math.nan,
            method=selection.method,
            reason=reason if inside else f"{reason}, at the end of the ceiling's range",
        )

    def _refuse(self, key: str, text: str, estimate: Estimate) -> Answer:
        """Say a refusal once: again only after an estimate has been accepted or the reason has changed."""
        said, self._refusal = self._refusal == key, key
        if said:
            return Answer(self._command)
        value = estimate.frequency if key == OFF_RESONANCE else estimate.amplitude
        return Answer(self._command, "refused", f"the ceiling stays: {text}", value)


class ProfileController:
    """Sends the heights a scene prescribes, for scenes whose ceiling no controller moves."""

    def hear(self, kind: str) -> None:
        """Nothing moves this ceiling but the scene."""

    def __init__(self, heights: tuple[tuple[float, float], ...]) -> None:
        """Take the points (t [s], h [m]), straight in between."""
        self._times, self._heights = zip(*heights, strict=True)
        self._command = Command(method="fixed")

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """See `Controller.answer`."""
        del estimate, height
        target = float(np.interp(time, self._times, self._heights))
        if target != self._command.height:
            self._command = replace(
                self._command, sequence=self._command.sequence + 1, height=target, reason="prescribed by the scene"
            )
        return Answer(self._command)
