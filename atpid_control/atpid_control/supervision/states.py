# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which nodes answer, the states of a run, and what each permits the motor (docs/graph.md, "Supervision")."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from atpid_common.errors import InputError
from atpid_common.vocabulary import RunState


class SupervisionError(InputError):
    """Invalid settings of the supervision."""


@dataclass(frozen=True)
class Change:
    """A node that has fallen silent, or answers again, and how long it was silent [s]."""

    name: str
    silence: float
    back: bool


class NodeLiveness:
    """The answers of the nodes. Times are steady [s]; those in which the supervisor itself was held up do not count."""

    def __init__(self, nodes: Sequence[str], answer_time: float, turn: float) -> None:
        """Wait for the first answers.

        nodes: their names; answer_time: silence that is reported [s]; turn: longest time between two calls of `check`
        in which the supervisor has not been held up [s]. Raises SupervisionError.
        """
        if len(set(nodes)) < len(nodes) or not nodes:
            raise SupervisionError(f"nodes: given {', '.join(nodes) or 'none'}; allowed: one or more, each once")
        if not 0.0 < turn < answer_time:
            raise SupervisionError(f"answer_time: given {answer_time:g} s; allowed: above {turn:g} s")
        self.nodes = tuple(nodes)
        self._answer_time, self._turn = answer_time, turn
        self._last: dict[str, float] = {}
        self._checked: float | None = None
        self._silent: set[str] = set()

    def answered(self, name: str, now: float) -> None:
        """Take an answer of a node; one of a node that is not supervised is an error."""
        if name not in self.nodes:
            raise SupervisionError(f"nodes: given an answer of {name}; allowed: {', '.join(self.nodes)}")
        self._last[name] = max(now, self._last.get(name, -math.inf))

    def check(self, now: float, ended: Collection[str] = ()) -> list[Change]:
        """Return which nodes have fallen silent, and which answer again, since the last check.

        ended: nodes whose process is known to have ended; they are silent at once.
        """
        held_up = 0.0 if self._checked is None else max(now - self._checked - self._turn, 0.0)
        self._checked = now
        changes = []
        for name in self._last:
            silence = now - self._last[name]
            if name in self._silent:
                if silence <= self._answer_time and name not in ended:
                    self._silent.remove(name)
                    changes.append(Change(name, silence, back=True))
                continue
            # what came meanwhile has not been received yet: the time in which this process stood does not count
            self._last[name] = min(self._last[name] + held_up, now)
            if now - self._last[name] > self._answer_time or name in ended:
                self._silent.add(name)
                changes.append(Change(name, silence, back=False))
        return changes

    def silence(self, name: str, now: float) -> float:
        """Return how long ago a node answered last [s]; NaN: it has not answered yet."""
        return now - self._last[name] if name in self._last else math.nan

    @property
    def silent(self) -> tuple[str, ...]:
        """Nodes that have answered and do not any more."""
        return tuple(name for name in self.nodes if name in self._silent)

    @property
    def awaited(self) -> tuple[str, ...]:
        """Nodes that have not answered yet."""
        return tuple(name for name in self.nodes if name not in self._last)


@dataclass(frozen=True)
class Situation:
    """The state, what the motor may do, and why."""

    state: RunState
    permit: bool  # the motor may be armed, and may move
    stop: bool  # the motor is to be disarmed at once, and stays so until it is armed again
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
