# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording that begins when a signal passes a level, with what came before it from a memory of bounded size."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_control.runs.decode import Decoded, Described
from atpid_control.runs.errors import BagError
from atpid_control.runs.topics import BLOCK, EVENT, TRANSITION, BlockShape, Topic, decoder_of, shape_of

EDGES = ("rising", "falling", "either")
#: Events and transitions from before the pre-trigger time that are kept: what publishers of `events` keep, too.
STATES = 100
#: Memory of a message besides its bytes.
_OVERHEAD = 300


@dataclass(frozen=True)
class Trigger:
    """When a recording begins, and ends again."""

    topic: str
    signal: str  # a channel of its blocks, or a field of its messages that is a number
    level: float  # [unit of the signal]
    edge: str = "rising"
    pre: float = 1.0  # recorded before the sample that passes the level [s]
    post: float = 0.0  # and after it [s]; 0: until the run ends
    memory: int = 2**26  # for messages held meanwhile [bytes]


class _WaitingMessage(NamedTuple):
    """A message that waits."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int
    last_ns: int  # instant of its last sample, or its stamp [ns]


class _Fired(NamedTuple):
    """The sample that passed the level."""

    time_ns: int
    scan: int | None  # index of the scan; None: a message has none
    value: float  # [unit of the signal]


def trigger_of(text: str, topics: list[Topic], **settings: Any) -> Trigger | None:
    """Return the trigger on "TOPIC SIGNAL"; None for an empty text. Raises BagError: no such topic or field."""
    words = text.split()
    if not words:
        return None
    topic = next((topic for topic in topics if topic.name.lstrip("/") == words[0].lstrip("/")), None)
    if len(words) != 2 or topic is None:
        names = ", ".join(topic.name for topic in topics)
        raise BagError(f"parameter trigger: given {text!r}; allowed: 'TOPIC SIGNAL', with a topic of {names}")
    found = Trigger(topic.name, words[1], **settings)
    if not math.isfinite(found.level):
        raise BagError(f"parameter trigger_level: given {found.level}; allowed: a number, in the unit of the signal")
    if topic.type != BLOCK:
        fields = decoder_of(topic.type).fields(topic.type)
        numbers = [name for name, described in fields.items() if _is_number(described)]
        if found.signal not in numbers:
            allowed = ", ".join(numbers) or "none of its fields is a number"
            raise BagError(f"parameter trigger: {topic.name} has no number {found.signal!r}; allowed: {allowed}")
    return found


class PreTrigger:
    """Holds messages until the signal passes its level, then hands on what is recorded."""

    def __init__(self, trigger: Trigger, topics: list[Topic]) -> None:
        """Wait for `trigger` on one of `topics`."""
        self.trigger = trigger
        self.fired: _Fired | None = None
        self.complaint = ""  # why the signal cannot be read, once
        self._dropped_ns: int | None = None  # end of the newest message dropped for want of memory
        self._types = {topic.name: topic.type for topic in topics}
        self._held: deque[_WaitingMessage] = deque()
        self._states: deque[_WaitingMessage] = deque(maxlen=STATES)
        self._bytes = 0
        self._last_ns = 0  # of the last block of the signal that is recorded after the trigger
        self._previous = math.nan  # value of the signal
        self._limit_ns: int | None = None  # what ended before it is not needed

    @property
    def shortened(self) -> bool:
        """Whether less than the pre-trigger time was held, for want of memory."""
        return self._dropped_ns is not None and self._limit_ns is not None and self._dropped_ns >= self._limit_ns

    @property
    def stop_ns(self) -> int | None:
        """Instant after which nothing is recorded; None: not known, or the run's end."""
        if self.fired is None or not self.trigger.post:
            return None
        return self.fired.time_ns + round(self.trigger.post * 1e9)

    def push(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> list[_WaitingMessage]:
        """Take a message; return those to be recorded now, in their order."""
        shape = shape_of(self._types[topic], data)
        last = publish_ns if shape is None else publish_ns + round(max(0, shape.scans - 1) / shape.rate * 1e9)
        one = _WaitingMessage(topic, data, log_ns, publish_ns, last)
        if self.fired is not None:
            return [one] if self._within(one) else []
        self._hold(one)
        if topic == self.trigger.topic:
            self.fired = self._look(one, shape)
            pre = round(self.trigger.pre * 1e9)
            self._limit_ns = (last if self.fired is None else self.fired.time_ns) - pre
            while self._held and self._held[0].last_ns < self._limit_ns:
                self._drop()
        if self.fired is None:
            return []
        kept = [*self._states, *self._held]
        self._states.clear()
        self._held.clear()
        self._bytes = 0
        return kept

    def _within(self, one: _WaitingMessage) -> bool:
        """Whether a message is recorded after the trigger: the last block is whole, and what answers it is with it."""
        stop = self.stop_ns
        if stop is not None and one.publish_ns > stop:
            return one.publish_ns <= self._last_ns
        if one.topic == self.trigger.topic:
            self._last_ns = one.last_ns
        return True

    def _hold(self, one: _WaitingMessage) -> None:
        self._held.append(one)
        self._bytes += len(one.data) + _OVERHEAD
        while self._bytes > self.trigger.memory and len(self._held) > 1:
            self._dropped_ns = self._held[0].last_ns
            self._drop()

    def _drop(self) -> None:
        one = self._held.popleft()
        self._bytes -= len(one.data) + _OVERHEAD
        if self._types[one.topic] in (EVENT, TRANSITION):
            self._states.append(one)

    def _look(self, one: _WaitingMessage, shape: BlockShape | None) -> _Fired | None:
        """Return the first sample of a message that passes the level; None: none does."""
        try:
            message = decoder_of(self._types[one.topic]).decode(0, one.data)
        except BagError:  # recorded as it is, like any other message
            return None
        try:
            values = self._values(message)
        except (AttributeError, ValueError):
            has = ", ".join(getattr(message, "channels", ())) or "no channels"
            self.complaint = f"{one.topic} has no channel {self.trigger.signal!r} to trigger on; it has {has}"
            return None
        places = np.flatnonzero(np.isfinite(values))
        chain = np.concatenate(([self._previous], values[places]))
        if len(places):
            self._previous = float(chain[-1])
        crossed = np.flatnonzero(_crossings(chain, self.trigger))
        if not len(crossed):
            return None
        place = int(places[crossed[0]])
        if shape is None:
            return _Fired(one.publish_ns, None, float(values[place]))
        return _Fired(one.publish_ns + round(place / shape.rate * 1e9), shape.first_index + place, float(values[place]))

    def _values(self, message: Decoded) -> NDArray[np.float64]:
        if self._types[self.trigger.topic] != BLOCK:
            return np.atleast_1d(np.asarray(getattr(message, self.trigger.signal), dtype=np.float64))
        channels = list(message.channels)
        data = np.asarray(message.data, dtype=np.float64).reshape(-1, max(1, len(channels)))
        return data[:, channels.index(self.trigger.signal)]


def _crossings(values: NDArray[np.float64], trigger: Trigger) -> NDArray[np.bool_]:
    """Return for each value but the first, shape (n - 1,), whether the signal passes the level with it; NaN: none."""
    before, after, level = values[:-1], values[1:], trigger.level
    rising = (before < level) & (after >= level)
    falling = (before > level) & (after <= level)
    return {"rising": rising, "falling": falling}.get(trigger.edge, rising | falling)


def _is_number(described: Described) -> bool:
    """Whether a field, as rosbags describes it, is one number, or a sequence of them."""
    node, rest = described
    if node.name == "BASE":
        return str(rest[0]).startswith(("float", "int", "uint"))
    return node.name in ("ARRAY", "SEQUENCE") and _is_number(rest[0])
