# SPDX-License-Identifier: Apache-2.0
"""From each estimate to one command: hold, selection, the ceiling's range, refusals said once, the step back."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from atpid_control.hold import OFF_RESONANCE, Estimate, Hold, HoldError, Verdict
from atpid_control.selection.protocol import HeightSelector, Selection, SelectionError

#: A ceiling this close to where it was sent is there [m].
_ARRIVED = 2e-3

#: A beam that swings less than this share of what it did so many estimates ago is calming down.
_FALLING, _DECAY = 0.97, 8


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
    kind: str = ""  # refused or step_back; empty: nothing to say
    text: str = ""
    value: float = math.nan


@dataclass(frozen=True)
class StepBack:
    """How the ceiling leaves a rumble."""

    share: float  # of the clearance above the lowest height given up each time [-]
    settle: int  # estimates after the ceiling has come to rest in which the beam may do anything
    count: int  # estimates in a row that rumble after that, before each step
    excess: float  # amplitude of the beam above the predicted that is more than inaccuracy [-]

    def __post_init__(self) -> None:
        """Refuse a step that is none or crosses the lowest height."""
        if not 0.0 < self.share < 1.0:
            raise HoldError(f"step_back: given {self.share}; allowed: above 0 and below 1")
        if self.count < 1 or self.settle < 0:
            given = f"{self.count} and {self.settle}"
            raise HoldError(f"rumble_count and settle_count: given {given}; allowed: at least 1 and at least 0")
        if not self.excess >= 0.0:
            raise HoldError(f"step_back_excess: given {self.excess}; allowed: at least 0")


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
        self, hold: Hold, selector: HeightSelector, limits: tuple[float, float], margin: float, step_back: StepBack
    ) -> None:
        """Take the hold, the method, the lowest and highest height [m], the margin in standard deviations [-]."""
        self._hold, self._selector, self._limits, self._margin = hold, selector, limits, margin
        self._step_back = step_back
        self._rumbling = False
        self._rumbled = 0  # estimates in a row
        self._stood = 0  # likewise, with the ceiling where it was sent
        self._expected = math.nan  # amplitude of the beam at the height selected [m]
        self._swings: deque[float] = deque(maxlen=_DECAY)  # the beam's latest amplitudes [m]
        self._command = Command(method=selector.method)
        self._refusal = ""

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """See `Controller.answer`."""
        del time
        verdict = self._hold.judge(estimate)
        rumbles = self._rumbles(estimate.beam_amplitude, height)
        self._rumbled = self._rumbled + 1 if rumbles and not verdict.select else 0
        if verdict.select:
            return self._select(verdict, estimate, height)
        if self._rumbled >= self._step_back.count:
            return self._stepped_back()
        self._command = replace(self._command, reason=verdict.reason)
        return self._refuse(verdict.reason, verdict.reason, estimate) if verdict.refused else self._accept()

    def hear(self, kind: str) -> None:
        """See `Controller.hear`."""
        if kind in ("rumble", "calm"):
            self._rumbling = kind == "rumble"

    def _rumbles(self, swing: float, height: float) -> bool:
        """Whether the height is to blame for an irregular response: the ceiling stands, the beam does not calm down.

        On the way, and while what was swinging before dies out, the response is irregular at any height.
        """
        self._swings.append(swing)
        dying = len(self._swings) == _DECAY and swing < _FALLING * self._swings[0]
        as_expected = swing <= (1.0 + self._step_back.excess) * self._expected
        self._stood = self._stood + 1 if abs(height - self._command.height) <= _ARRIVED else 0
        settled = self._stood > self._step_back.settle
        return self._rumbling and settled and not dying and not as_expected

    def _stepped_back(self) -> Answer:
        self._rumbled = 0
        before, lowest = self._command.height, self._limits[0]
        height = before - self._step_back.share * (before - lowest)
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
        self._command = self._limited(selection, verdict)
        self._expected = self._command.predicted_amplitude
        return self._accept()

    def _limited(self, selection: Selection, verdict: Verdict) -> Command:
        low, high = self._limits
        height = min(max(selection.height, low), high)
        inside = height == selection.height
        return Command(
            sequence=self._command.sequence + 1,
            height=height,
            excitation_amplitude=verdict.amplitude,
            predicted_amplitude=selection.beam_amplitude if inside else math.nan,
            method=selection.method,
            reason=verdict.reason if inside else f"{verdict.reason}, at the end of the ceiling's range",
        )

    def _refuse(self, key: str, text: str, estimate: Estimate) -> Answer:
        """Say a refusal once: again only after an estimate has been accepted or the reason has changed."""
        said, self._refusal = self._refusal == key, key
        if said:
            return Answer(self._command)
        value = estimate.frequency if key == OFF_RESONANCE else estimate.amplitude
        return Answer(self._command, "refused", f"the ceiling stays: {text}", value)

    def _accept(self) -> Answer:
        self._refusal = ""
        return Answer(self._command)


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
