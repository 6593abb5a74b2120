# SPDX-License-Identifier: Apache-2.0
"""Compares the estimates and commands of a replay with those of the bag, message by message."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from atpid_control.bags.read import Bag, stamp_of

#: What is compared of each message type: what the controller and the ceiling act on, not the wording of a reason.
COMPARED = {
    "Excitation": ("quality", "amplitude", "frequency"),
    "CeilingCommand": ("sequence", "height", "excitation_amplitude", "method"),
}
#: Another processor rounds otherwise; a height is positioned to 1e-4 m, an amplitude measured to 1e-5 m.
RELATIVE, ABSOLUTE = 1e-6, 1e-9


@dataclass(frozen=True)
class Agreement:
    """How many messages of a topic the replay repeats."""

    topic: str
    recorded: int
    agreeing: int
    first_difference: str  # in words; empty: all agree

    def __str__(self) -> str:
        """Return one line."""
        line = f"{self.topic}: {self.agreeing} of {self.recorded} agree"
        return f"{line}; first difference: {self.first_difference}" if self.first_difference else line


def compare(recorded: Bag, replayed: Bag) -> list[Agreement]:
    """Return the agreement of every topic with estimates or commands; messages belong together by their stamps."""
    topics = [(topic, kind) for kind in COMPARED for topic in recorded.topics_of(kind)]
    return [_agreement(recorded, replayed, topic, COMPARED[kind]) for topic, kind in topics]


def _agreement(recorded: Bag, replayed: Bag, topic: str, names: tuple[str, ...]) -> Agreement:
    found = {stamp_of(message): message for _, message in replayed.messages(topic)}
    messages = [message for _, message in recorded.messages(topic)]
    start = min(map(stamp_of, messages), default=0)
    differing = [text for message in messages for text in _difference(message, found, names, start)]
    return Agreement(topic, len(messages), len(messages) - len(differing), differing[0] if differing else "")


def _difference(message: Any, found: dict[int, Any], names: tuple[str, ...], start: int) -> Iterator[str]:
    """Yield in words how `message` differs from the one with its stamp; nothing where it does not."""
    at = f"{(stamp_of(message) - start) * 1e-9:.3f} s after the first"
    again = found.get(stamp_of(message))
    if again is None:
        yield f"{at}, no answer"
        return
    pairs = {name: (getattr(message, name), getattr(again, name)) for name in names}
    differing = [f"{name} {one!r} is now {other!r}" for name, (one, other) in pairs.items() if not _equal(one, other)]
    if differing:
        yield f"{at}, {', '.join(differing)}"


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        both_unknown = math.isnan(one) and math.isnan(other)
        return both_unknown or math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return bool(one == other)
