# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The order of the messages in a bag made in lockstep: by their stamps, whatever order they arrive in."""

import heapq
from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

#: How far behind the slowest topic of the loop messages are written [ns]: ten blocks, for events that come late.
HOLD_BACK_NS = 500_000_000


class UnorderedMessage(NamedTuple):
    """A message that waits for its place; compares by stamp, topic, sender and arrival."""

    stamp_ns: int
    rank: int  # of the topic in the recorder's list
    node: str  # of an event; empty: a topic of one node
    arrival: int
    topic: str
    data: bytes


class StampOrder:
    """Sorts messages by (stamp, order of topics, sender, arrival), whatever order they arrived in.

    Two runs in lockstep with one seed then give the same sequence, although DDS delivers topics side by side. A message
    is ready when every topic of the loop has passed its stamp by the hold-back.
    """

    def __init__(self, topics: list[str], loop: set[str], hold_back_ns: int = HOLD_BACK_NS) -> None:
        """Sort messages of `topics`; those in `loop` carry every stamp of the run and so show its progress."""
        self._ranks = {topic: rank for rank, topic in enumerate(topics)}
        self._loop, self._hold_back = loop, hold_back_ns
        self._newest: dict[str, int] = {}
        self._held: list[UnorderedMessage] = []
        self._arrivals = count()

    def __len__(self) -> int:
        return len(self._held)

    def add(self, topic: str, stamp_ns: int, node: str, data: bytes) -> None:
        """Take one message."""
        heapq.heappush(
            self._held, UnorderedMessage(stamp_ns, self._ranks[topic], node, next(self._arrivals), topic, data)
        )
        if topic in self._loop:
            self._newest[topic] = max(stamp_ns, self._newest.get(topic, stamp_ns))

    def ready(self) -> Iterator[UnorderedMessage]:
        """Yield, in order, the messages that no later one can precede."""
        if not self._newest:
            return
        limit = min(self._newest.values()) - self._hold_back
        while self._held and self._held[0].stamp_ns < limit:
            yield heapq.heappop(self._held)

    def rest(self) -> Iterator[UnorderedMessage]:
        """Yield all that is left, in order: the run is over."""
        while self._held:
            yield heapq.heappop(self._held)
