# SPDX-License-Identifier: Apache-2.0
"""Subscriptions whose messages are checked where they enter; what cannot be used is counted and dropped."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from atpid_common.message_checks import check
from atpid_common.nodes.dropped import Dropped


def subscribe(
    node: Node, kind: type[Any], topic: str, callback: Callable[..., object], qos: QoSProfile, **options: Any
) -> Subscription:
    """Subscribe as `node.create_subscription` does; messages that cannot be used do not reach `callback`."""
    dropped = Dropped.of(node)

    def with_info(message: Any, info: dict[str, int]) -> None:
        reason = check(message)
        if reason:
            dropped.add(topic, reason)
        elif takes_info:
            callback(message, info)
        else:
            callback(message)

    def without_info(message: Any) -> None:
        with_info(message, {})

    takes_info = len(signature(callback).parameters) == 2  # which rclpy finds out in the same way
    return node.create_subscription(kind, topic, with_info if takes_info else without_info, qos, **options)
