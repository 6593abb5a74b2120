# SPDX-License-Identifier: Apache-2.0
"""The monitors of a node of the loop: silent inputs, quality of service, diagnostics."""

from __future__ import annotations

from collections.abc import Callable

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.messages import EVENTS, nanoseconds_of
from atpid_common.nodes.parameters import Publish
from atpid_common.nodes.qos_monitor import QosMonitor
from atpid_common.nodes.stale_monitor import StaleMonitor


class Supervision:
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
        self.stale = StaleMonitor(node, publish, stale_timeout, self._silence, enabled=enabled)
        self.qos = QosMonitor(node, publish, self.report, enabled=enabled)
        self._diagnostics = DiagnosticsPublisher(node, self._all) if enabled else None

    def follow_events(self) -> None:
        """Subscribe to `events` for the end of a run; a node that subscribes by itself calls `on_event`."""
        if self._enabled:
            self._node.create_subscription(Event, "events", self.on_event, EVENTS)

    def on_event(self, event: Event) -> None:
        """Expect no further messages after the end of a run."""
        if event.kind == Event.FINISHED:
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
