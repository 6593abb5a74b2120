# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes under test in this process, and a peer that listens to their diagnostics: a graph in a domain of its own."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from spun import Apart

from atpid_common.nodes.messages import STATES


class NodeGraph(Apart):
    """A peer, and the nodes that are made beside it, on one executor."""

    def __init__(self) -> None:
        super().__init__()
        self.statuses: list[DiagnosticStatus] = []
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += array.status

    def collect(self, kind: Any, topic: str, profile: QoSProfile | int = STATES) -> list[Any]:
        """Return a list to which the messages of a topic are appended."""
        messages: list[Any] = []
        self.peer.create_subscription(kind, topic, messages.append, profile)
        return messages

    def set(self, node: str, name: str, value: Any) -> Any:
        given = [Parameter(name, value=value).to_parameter_msg()]
        return self.call(f"{node}/set_parameters", SetParameters, parameters=given).results[0]
