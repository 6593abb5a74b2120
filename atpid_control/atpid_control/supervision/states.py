# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The states of a supervised run, and what each permits the motor (docs/graph.md, "Supervision")."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from atpid_common.vocabulary import RunState
from atpid_control.supervision.answers import NodeLiveness, SupervisionError


@dataclass(frozen=True)
class Situation:
    """The state, what the motor may do, and why."""

    state: RunState
    permit: bool  # the motor may be armed, and may move
    stop: bool  # the motor is to be switched off at once, and stays off
    reason: str  # one line; empty: ready


class Supervision:
    """Decides the state from the answers of the nodes; a stop is latched until `rearm`."""

    def __init__(self, answers: NodeLiveness, needed: Sequence[str]) -> None:
        """Begin. needed: nodes without whose answers the motor must not move. Raises SupervisionError."""
        unknown = [name for name in needed if name not in answers.nodes]
        if unknown or not needed:
            given = ", ".join(unknown) or "none"
            raise SupervisionError(f"needed: given {given}; allowed: one or more of {', '.join(answers.nodes)}")
        self._answers, self._needed = answers, tuple(needed)
        self._stopped = ""
        self._ended = False
        self._absent: dict[str, float] = {}  # when a node's process was last seen to be missing, steady [s]

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
            text = f"{self._stopped}; supervisor_node/rearm arms it again"
            return Situation(RunState.SAFE, permit=False, stop=True, reason=text)
        if self._ended:
            return Situation(RunState.SHUTDOWN, permit=False, stop=False, reason="the supervisor ends")
        lost = [name for name in silent if name in self._needed]
        if lost:
            return Situation(RunState.FAULT, permit=False, stop=False, reason=f"no answer of {', '.join(lost)}")
        permit = not any(name in self._needed for name in awaited)
        if awaited:
            return Situation(RunState.STARTING, permit, stop=False, reason=f"no answer yet of {', '.join(awaited)}")
        if silent:
            return Situation(RunState.DEGRADED, permit, stop=False, reason=f"no answer of {', '.join(silent)}")
        return Situation(RunState.READY, permit, stop=False, reason="")

    def given_up(
        self, now: float, give_up: float, restart_time: float = 0.0, runs: Callable[[str], bool] = lambda _: True
    ) -> str:
        """Return the needed node that has been silent for `give_up` [s] (0: never); empty: none.

        restart_time: how long one whose process has ended may be away [s], in which its silence does not count;
        runs: whether a node has a process.
        """
        for name in self._answers.silent:
            silence = self._answers.silence(name, now)
            if name in self._needed and silence < restart_time and not runs(name):
                self._absent[name] = now
            since = self._absent.get(name, -math.inf) if silence < restart_time else -math.inf
            if name in self._needed and min(silence, now - since) > give_up > 0.0:
                return name
        return ""
