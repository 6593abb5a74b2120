# SPDX-License-Identifier: Apache-2.0
"""From each estimate to one command: hold, selection, the ceiling's range, and each refusal said once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from atpid_control.hold import OFF_RESONANCE, Estimate, Hold, Verdict
from atpid_control.selection.protocol import HeightSelector, Selection, SelectionError


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
    """The command that answers one estimate and, where something has to be said, the refusal and its quantity."""

    command: Command
    refusal: str = ""
    value: float = math.nan


class Controller(Protocol):
    """What answers each estimate."""

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """Answer one estimate at `time` since the start [s], the ceiling being at `height` [m] (NaN: unknown)."""
        ...


class SelectingController:
    """Selects a height when the hold says so; otherwise repeats the last command, which is how it shows to be alive."""

    def __init__(self, hold: Hold, selector: HeightSelector, limits: tuple[float, float], margin: float) -> None:
        """Take the hold, the method, the lowest and highest height [m], and the margin in standard deviations [-]."""
        self._hold, self._selector, self._limits, self._margin = hold, selector, limits, margin
        self._command = Command(method=selector.method)
        self._refusal = ""

    def answer(self, time: float, estimate: Estimate, height: float) -> Answer:
        """See `Controller.answer`."""
        del time
        verdict = self._hold.judge(estimate)
        if verdict.select:
            return self._select(verdict, estimate, height)
        self._command = replace(self._command, reason=verdict.reason)
        return self._refuse(verdict.reason, verdict.reason, estimate) if verdict.refused else self._accept()

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
        return Answer(self._command, f"the ceiling stays: {text}", value)

    def _accept(self) -> Answer:
        self._refusal = ""
        return Answer(self._command)


class ProfileController:
    """Sends the heights a scene prescribes, for scenes whose ceiling no controller moves."""

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
