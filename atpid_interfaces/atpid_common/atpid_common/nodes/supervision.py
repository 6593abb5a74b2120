# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The monitors of a node of the loop: silent inputs, quality of service, diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import nan
from typing import Any

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher, status
from atpid_common.nodes.messages import EVENTS, nanoseconds_of
from atpid_common.nodes.parameters import Publish
from atpid_common.nodes.stale_monitor import StaleMonitor


class NodeMonitors:
    """The monitors of a node; whatever they report is in `/diagnostics` at once, and once a second."""

    def __init__(
        self,
        node: Node,
        publish: Publish,
        statuses: Callable[[], list[DiagnosticStatus]],
        stale_timeout: float,
        on_silence: Callable[[], None] = lambda: None,
        *,
        enabled: bool,
    ) -> None:
        """Begin.

        publish: publishes an event; statuses: returns the node's own statuses; stale_timeout: silence that is reported
        [s]; on_silence: called after an input has fallen silent or resumed; enabled: false in lockstep, where nothing
        depends on the clock of the wall.
        """
        self._node, self._statuses, self._on_silence, self._enabled = node, statuses, on_silence, enabled
        self._sources: set[str] = set()
        self.stale = StaleMonitor(node, publish, stale_timeout, self._silence, enabled=enabled)
        self.qos = QosMonitor(node, publish, self.report, enabled=enabled)
        self._diagnostics = DiagnosticsPublisher(node, self._all) if enabled else None

    def follow_events(self) -> None:
        """Subscribe to `events` for the end of a run; a node that subscribes by itself calls `on_event`."""
        if self._enabled:
            subscribe(self._node, Event, "events", self.on_event, EVENTS)

    def on_event(self, event: Event) -> None:
        """Expect no further messages after the end of a run, which counts from a source that announced its begin."""
        source = event.node
        if event.kind == Event.STARTED:
            self._sources.add(source)
        elif event.kind == Event.FINISHED and (not self._sources or source in self._sources):
            self.stale.end(nanoseconds_of(event.header.stamp))

    def report(self) -> None:
        """Publish diagnostics now: something has changed."""
        if self._diagnostics is not None:
            self._diagnostics.publish()

    def close(self) -> None:
        """Stop the timers."""
        self.stale.cancel()
        if self._diagnostics is not None:
            self._diagnostics.cancel()

    def _silence(self) -> None:
        self._on_silence()
        self.report()

    def _all(self) -> list[DiagnosticStatus]:
        return [*self._statuses(), self.stale.status(), self.qos.status()]


class QosMonitor:
    """Reports what the middleware reports: incompatible quality of service, and deadlines that were missed.

    It makes the event callbacks of a node's publishers and subscriptions, and collects what they are called with.
    """

    def __init__(self, node: Node, publish: Publish, changed: Callable[[], None], *, enabled: bool) -> None:
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
        incompatible = partial(self._on_incompatible, topic, "subscription")
        return PublisherEventCallbacks(incompatible_qos=incompatible, deadline=missed)

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
        self._publish(Event.WARNING, Event.QOS, text, nan)
        self._changed()

    def _on_missed(self, topic: str, counts: Callable[[], bool], event: Any) -> None:
        """Count; the silence itself is an event of the nodes that do not receive the messages."""
        if counts():
            self._missed[topic] = self._missed.get(topic, 0) + event.total_count_change
            self._changed()
