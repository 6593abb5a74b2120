# SPDX-License-Identifier: Apache-2.0
"""Reports what the middleware reports: incompatible quality of service, and deadlines that were missed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.parameters import Publish


class QosMonitor:
    """Makes the event callbacks of a node's publishers and subscriptions, and collects what they are called with."""

    def __init__(self, node: Node, publish: Publish, changed: Callable[[], None], *, enabled: bool = True) -> None:
        """Begin; publish: publishes an event; changed: called after each report; enabled: false in lockstep."""
        self._node, self._publish, self._changed, self._enabled = node, publish, changed, enabled
        self._incompatible: dict[str, str] = {}
        self._missed: dict[str, int] = {}

    def publisher(
        self, topic: str, deadline_counts: Callable[[], bool] | None = None
    ) -> PublisherEventCallbacks | None:
        """Return the callbacks of a publisher; None where nothing is to be reported.

        deadline_counts: for a publisher that offers a deadline, whether missing it means anything now: between two runs
        nothing is published.
        """
        if not self._enabled:
            return None
        missed = partial(self._on_missed, topic, deadline_counts) if deadline_counts is not None else None
        return PublisherEventCallbacks(
            incompatible_qos=partial(self._on_incompatible, topic, "subscription"), deadline=missed
        )

    def subscription(self, topic: str) -> SubscriptionEventCallbacks | None:
        """Return the callbacks of a subscription; None where nothing is to be reported."""
        if not self._enabled:
            return None
        return SubscriptionEventCallbacks(incompatible_qos=partial(self._on_incompatible, topic, "publisher"))

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: quality of service"."""
        level = DiagnosticStatus.ERROR if self._incompatible else DiagnosticStatus.OK
        text = "; ".join(self._incompatible.values()) or "compatible"
        values = {f"{topic} deadlines missed": count for topic, count in self._missed.items()}
        return status(self._node, "quality of service", level, text, values)

    def _on_incompatible(self, topic: str, partner: str, event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower().removesuffix("_qos_policy")
        text = (
            f"{topic}: a {partner} has another {policy}, so that no message passes; "
            f"`ros2 topic info --verbose {self._node.resolve_topic_name(topic)}` shows both"
        )
        self._incompatible[topic] = text
        self._publish(Event.WARNING, Event.QOS, text)
        self._changed()

    def _on_missed(self, topic: str, counts: Callable[[], bool], event: Any) -> None:
        """Count; the silence itself is an event of the nodes that do not receive the messages."""
        if counts():
            self._missed[topic] = self._missed.get(topic, 0) + event.total_count_change
            self._changed()
