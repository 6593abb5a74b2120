# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which nodes answer: each is asked again and again, and is silent when it has not answered for the answer time."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from atpid_common.errors import InputError


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
