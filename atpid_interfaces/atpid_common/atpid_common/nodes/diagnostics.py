# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Publishes a node's state once a second on the absolute topic `/diagnostics` (REP 107)."""

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from atpid_common.nodes.checked import Dropped
from atpid_common.nodes.messages import STEADY

TOPIC = "/diagnostics"
PERIOD = 1.0  # [s]


def status(
    node: Node, task: str, level: bytes, message: str, values: Mapping[str, object], hardware_id: str = "none"
) -> DiagnosticStatus:
    """Return one status, named "NODE: TASK" as diagnostic_updater names them; `values` are printed as they are."""
    return DiagnosticStatus(
        level=level,
        name=f"{node.get_fully_qualified_name().lstrip('/')}: {task}",
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


class DiagnosticsPublisher:
    """Publishes the statuses that `statuses` returns, once a second of steady time and whenever `publish` is called."""

    def __init__(self, node: Node, statuses: Callable[[], list[DiagnosticStatus]]) -> None:
        self._node, self._statuses = node, statuses
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, 10)
        self._timer = node.create_timer(PERIOD, self.publish, clock=STEADY)

    def publish(self) -> None:
        """Publish now."""
        if not self._node.context.ok():
            return
        array = DiagnosticArray(status=[*self._statuses(), *self._dropped()])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _dropped(self) -> list[DiagnosticStatus]:
        """Return one status where messages were dropped; none where all could be used."""
        dropped = Dropped.of(self._node)
        if not dropped.by_topic:
            return []
        text = f"{dropped.by_topic.total()} messages dropped; the last on {dropped.last}"
        return [status(self._node, "messages", DiagnosticStatus.WARN, text, dropped.by_topic)]

    def cancel(self) -> None:
        """Stop the timer."""
        self._timer.cancel()
