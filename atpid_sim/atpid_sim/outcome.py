# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outcomes of a run; each has a sentence with the cause and what to do."""

from enum import IntEnum

from atpid_common.errors import NumericalError


class Outcome(IntEnum):
    """The outcome of one integration; `sentence` describes it."""

    DONE = 0
    STEP_BUDGET = 1
    NOT_FINITE = 2
    ESCAPED = 3
    OVERLAP_TOO_DEEP = 4
    CEILING_CRUSHES = 5
    STALLED = 6
    LEDGER_OPEN = 7

    @property
    def sentence(self) -> str:
        """One sentence: what happened and what to do about it."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.DONE: "the run reached its end",
    Outcome.STEP_BUDGET: "the step budget was used up before the end: loosen the tolerance or shorten the run",
    Outcome.NOT_FINITE: "a state, force or input was not a finite number: look for NaN or overflow in the scene",
    Outcome.ESCAPED: "the grain left the container beyond its overlap: the result must not be used",
    Outcome.OVERLAP_TOO_DEEP: "the grain was pressed deeper into a wall than its radius: no contact law holds there",
    Outcome.CEILING_CRUSHES: "the ceiling came closer than the grain's diameter: keep the height at or above 2 r",
    Outcome.LEDGER_OPEN: "energy has come or gone that no force explains: tighten the tolerance, or take fidelity soft",
    Outcome.STALLED: "time stopped advancing: events follow each other faster than the clock resolves",
}


class NumericalFailure(NumericalError):  # noqa: N818  a failure is what it is
    """A run that ended in anything but DONE; the message states the cause."""
