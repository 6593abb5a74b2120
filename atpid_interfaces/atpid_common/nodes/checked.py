# SPDX-License-Identifier: Apache-2.0
"""Subscriptions whose messages are checked where they enter: what cannot be used is counted, logged once and dropped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from atpid_common.nodes.dropped import Dropped
from atpid_common.nodes.message_checks import check


def subscribe(
    node: Node, kind: type[Any], topic: str, callback: Callable[[Any], object], qos: QoSProfile, **options: Any
) -> Subscription:
    """Subscribe as `node.create_subscription` does; messages that cannot be used do not reach `callback`."""
    dropped = Dropped.of(node)

    def take(message: Any) -> None:
        reason = check(message)
        if reason:
            dropped.add(topic, reason)
        else:
            callback(message)

    return node.create_subscription(kind, topic, take, qos, **options)
