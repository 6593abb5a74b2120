# SPDX-License-Identifier: Apache-2.0
"""A subscriber that checks by the indices that no scan was lost, and answers the handshake of the sources."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from atpid_interfaces.msg import CeilingState, RecorderStatus, SampleBlock
from rclpy.node import Node

from atpid_common.nodes.messages import BLOCKS, STATUS

PERIOD_S = 0.05
INNER_STATUS = "recorder/inner_status"


@dataclass
class Tally:
    """What arrived on one topic."""

    channels: int = 0
    rate: float = 0.0
    """[Hz]."""
    blocks: int = 0
    scans: int = 0
    next_index: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """(expected index, index that came)."""
    dropped: int = 0
    backlog: int = 0
    """Most scans that ever waited in device and driver."""
    invalid: int = 0
    """Values that are NaN."""

    def add(self, block: SampleBlock) -> None:
        """Count one block."""
        self.channels, self.rate = len(block.channels), block.rate
        if block.first_index != self.next_index:
            self.gaps.append((self.next_index, block.first_index))
        scans = len(block.data) // self.channels
        self.blocks += 1
        self.scans += scans
        self.next_index = block.first_index + scans
        self.dropped = block.dropped
        self.backlog = max(self.backlog, block.backlog)
        self.invalid += int(np.isnan(np.frombuffer(block.data)).sum())

    @property
    def lost(self) -> int:
        """Scans that did not arrive, lost anywhere on their way."""
        return self.next_index - self.scans


class Listener(Node):
    """Tallies topics, and answers the sources as loop and recorder would until data come from all of them.

    With `behind_recorder` there is a real recorder too, its status remapped to INNER_STATUS: a topic is reported as
    received once both have received it.
    """

    def __init__(self, topics: tuple[str, ...], *, behind_recorder: bool, **kwargs: Any) -> None:
        super().__init__("load_listener", **kwargs)
        self.tallies = {topic: Tally() for topic in topics}
        self._received = dict.fromkeys(topics, 0)
        self._inner: RecorderStatus | None = None
        self._behind_recorder = behind_recorder
        self._state = self.create_publisher(CeilingState, "ceiling/state", 100)
        self._status = self.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self.create_subscription(RecorderStatus, INNER_STATUS, self._on_status, STATUS)
        for topic in topics:
            self.create_subscription(
                SampleBlock, topic, lambda block, topic=topic: self._on_block(topic, block), BLOCKS
            )
        self._timer = self.create_timer(PERIOD_S, self._answer)

    @property
    def streaming(self) -> bool:
        """Whether data arrive on every topic."""
        return all(tally.blocks for tally in self.tallies.values())

    @property
    def blocks(self) -> dict[str, int]:
        """Blocks that arrived on each topic."""
        return {topic: tally.blocks for topic, tally in self.tallies.items()}

    @property
    def recorded(self) -> dict[str, int]:
        """Blocks the recorder has written, for each topic."""
        if self._inner is None:
            return dict.fromkeys(self.tallies, 0)
        written = dict(zip(self._inner.topics, self._inner.written, strict=True))
        return {topic: int(written.get(self.resolve_topic_name(topic), 0)) for topic in self.tallies}

    def _on_status(self, status: RecorderStatus) -> None:
        self._inner = status

    def _on_block(self, topic: str, block: SampleBlock) -> None:
        self._received[topic] += 1
        if not block.handshake:
            self.tallies[topic].add(block)

    def _answer(self) -> None:
        if self.streaming:
            self._timer.cancel()
        state = CeilingState()
        state.handshake = True
        self._state.publish(state)
        received = [min(count, self._recorder_received(topic)) for topic, count in self._received.items()]
        self._status.publish(RecorderStatus(recording=True, topics=list(self._received), received=received))

    def _recorder_received(self, topic: str) -> int:
        if not self._behind_recorder:
            return 1
        if self._inner is None:
            return 0
        received = dict(zip(self._inner.topics, self._inner.received, strict=True))
        return int(received.get(self.resolve_topic_name(topic), 0))
