# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions whose messages are checked where they enter; what cannot be used is counted and dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from inspect import signature
from typing import Any, ClassVar, TypeVar
from weakref import WeakKeyDictionary

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from atpid_common.message_checks import check

M = TypeVar("M")
#: Takes a message, and what the middleware states of it where there is a second argument.
Callback = Callable[[M], object] | Callable[[M, dict[str, int]], object]


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


def subscribe(
    node: Node, kind: type[M], topic: str, callback: Callback[M], qos: QoSProfile, **options: Any
) -> Subscription:
    """Subscribe as `node.create_subscription` does; messages that cannot be used do not reach `callback`."""
    dropped = Dropped.of(node)
    act: Callable[..., object] = callback

    def with_info(message: M, info: dict[str, int]) -> None:
        reason = check(message)
        if reason:
            dropped.add(topic, reason)
        elif takes_info:
            act(message, info)
        else:
            act(message)

    takes_info = len(signature(callback).parameters) == 2  # which rclpy finds out in the same way
    checked = with_info if takes_info else lambda message: with_info(message, {})
    return node.create_subscription(kind, topic, checked, qos, **options)
