# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publishes a node's events and logs them, so that they are on `events` and on `/rosout`."""

from __future__ import annotations

from math import nan

from atpid_interfaces.msg import Event
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher

from atpid_common.nodes.handshake import empty
from atpid_common.nodes.messages import EVENTS_KEPT, STATUS


class EventPublisher:
    """The node's publisher on `events`, which keeps them: a recorder discovered later gets those before it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self.publisher = node.create_publisher(Event, "events", EVENTS_KEPT)
        self._of_handshake: Publisher | None = None

    def publish(self, severity: int, kind: str, text: str, value: float = nan, stamp: Time | None = None) -> None:
        """Publish and log one event.

        kind: a constant of Event; value: the quantity that decided, in SI units; stamp: when it happened, None: now.
        Does nothing after the context was shut down.
        """
        if not self._node.context.ok():
            return
        event = Event(node=self._node.get_name(), severity=severity, kind=kind, value=value, text=text)
        event.header.stamp = stamp if stamp is not None else self._node.get_clock().now().to_msg()
        self.publisher.publish(event)
        logger = self._node.get_logger()
        if severity == Event.ALARM:  # three places: rclpy ties a severity to the place it is called from
            logger.error(text)
        elif severity == Event.WARNING:
            logger.warning(text)
        else:
            logger.info(text)

    def publish_handshake(self) -> None:
        """Publish the handshake's event, from a publisher of its own: many of them must not displace what is kept."""
        if self._of_handshake is None:
            # created after the other one, and announced after it: a node that receives from this one has found both
            self._of_handshake = self._node.create_publisher(Event, "events", STATUS)
        event = empty(Event)
        event.kind = Event.HANDSHAKE
        self._of_handshake.publish(event)
