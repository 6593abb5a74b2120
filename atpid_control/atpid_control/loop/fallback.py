# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""When the chosen method fails or is late: the look-up answers in its place or, where there is no map, the hold."""

from dataclasses import replace

from atpid_common.vocabulary import EventKind, Severity
from atpid_control.loop.protocol import LoopAnswer
from atpid_control.selection.protocol import HeightSelector


class Fallback:
    """Counts the estimates that ask for a height and get none from the method; without a clock."""

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
