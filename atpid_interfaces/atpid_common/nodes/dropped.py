# SPDX-License-Identifier: Apache-2.0
"""Counts the messages that a node could not use."""

from __future__ import annotations

from collections import Counter
from typing import ClassVar
from weakref import WeakKeyDictionary

from rclpy.node import Node


class Dropped:
    """A node's dropped messages by topic; the first of each topic is logged, all are in its diagnostics."""

    _of: ClassVar[WeakKeyDictionary[Node, Dropped]] = WeakKeyDictionary()

    def __init__(self, node: Node) -> None:
        """Begin with none."""
        self._log = node.get_logger().error
        self.by_topic: Counter[str] = Counter()
        self.last = ""  # topic and reason

    @classmethod
    def of(cls, node: Node) -> Dropped:
        """Return the counts of a node."""
        if node not in cls._of:
            cls._of[node] = cls(node)
        return cls._of[node]

    def add(self, topic: str, reason: str) -> None:
        """Count a message on `topic`."""
        self.by_topic[topic] += 1
        self.last = f"{topic}: {reason}"
        if self.by_topic[topic] == 1:
            self._log(f"a message on {topic} is dropped: {reason}; further ones are counted in the diagnostics")
