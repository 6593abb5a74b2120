# SPDX-License-Identifier: Apache-2.0
"""The states of a supervised run, and what each permits the motor (docs/graph.md, "Supervision")."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from atpid_control.supervision.answers import Answers, SupervisionError


class State(IntEnum):
    """State of the run; the numbers are those of atpid_interfaces/SupervisorState."""

    STARTING = 0
    READY = 1
    DEGRADED = 2
    FAULT = 3
    SAFE = 4
    SHUTDOWN = 5


@dataclass(frozen=True)
class Situation:
    """The state, what the motor may do, and why."""

    state: State
    permit: bool  # the motor may be armed, and may move
    stop: bool  # the motor is to be switched off at once, and stays off
    reason: str  # one line; empty: ready


class Supervision:
    """Decides the state from the answers of the nodes; a stop is latched until `rearm`."""

    def __init__(self, answers: Answers, needed: Sequence[str]) -> None:
        """Begin. needed: nodes without whose answers the motor must not move. Raises SupervisionError."""
        unknown = [name for name in needed if name not in answers.nodes]
        if unknown or not needed:
            given = ", ".join(unknown) or "none"
            raise SupervisionError(f"needed: given {given}; allowed: one or more of {', '.join(answers.nodes)}")
        self._answers, self._needed = answers, tuple(needed)
        self._stopped = ""
        self._ended = False

    @property
    def stopped(self) -> str:
        """Why the run was stopped; empty: it was not."""
        return self._stopped

    def stop(self, reason: str) -> bool:
        """Stop until `rearm`; return False where it was stopped already: the first reason stays."""
        if self._stopped:
            return False
        self._stopped = reason
        return True

    def rearm(self) -> str:
        """Clear a stop. Return why not, one line; empty: done."""
        missing = [name for name in self._needed if name in (*self._answers.silent, *self._answers.awaited)]
        if missing:
            return f"{', '.join(missing)}: no answer; the motor stays off until there is one"
        self._stopped = ""
        return ""

    def end(self) -> None:
        """The supervisor ends: nothing is permitted any more."""
        self._ended = True

    def situation(self) -> Situation:
        """Return state, permission and reason."""
        silent, awaited = self._answers.silent, self._answers.awaited
        if self._stopped:
            return Situation(State.SAFE, permit=False, stop=True, reason=self._stopped)
        if self._ended:
            return Situation(State.SHUTDOWN, permit=False, stop=False, reason="the supervisor ends")
        lost = [name for name in silent if name in self._needed]
        if lost:
            return Situation(State.FAULT, permit=False, stop=False, reason=f"no answer of {', '.join(lost)}")
        permit = not any(name in self._needed for name in awaited)
        if awaited:
            return Situation(State.STARTING, permit, stop=False, reason=f"no answer yet of {', '.join(awaited)}")
        if silent:
            return Situation(State.DEGRADED, permit, stop=False, reason=f"no answer of {', '.join(silent)}")
        return Situation(State.READY, permit, stop=False, reason="")

    def given_up(self, now: float, give_up: float) -> str:
        """Return the needed node that has been silent for `give_up` [s] (0: never); empty: none."""
        lost = [name for name in self._answers.silent if name in self._needed]
        late = [name for name in lost if self._answers.silence(name, now) > give_up > 0.0]
        return late[0] if late else ""
