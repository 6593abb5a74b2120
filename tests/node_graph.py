# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes under test in this process, and a peer that publishes, receives and asks: a graph in a domain of its own."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from atpid_common.nodes.messages import STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import spin_until
from atpid_control.stand.domain import own_domain


class NodeGraph:
    """A peer, and the nodes that are made beside it, on one executor."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._stack.enter_context(own_domain())
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.peer = self.add(Node("peer", context=self.context))
        self.statuses: list[DiagnosticStatus] = []
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += array.status

    def add(self, node: Any) -> Any:
        """Let a node take part until the end; return it."""
        self.executor.add_node(node)
        self._stack.callback(node.destroy_node)
        return node

    def make(self, kind: Callable[..., Any], parameters: dict[str, Any], **options: Any) -> Any:
        """Return a node of a class, with parameters."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self.add(kind(parameter_overrides=overrides, context=self.context, **options))

    def collect(self, kind: Any, topic: str, profile: QoSProfile | int = STATES) -> list[Any]:
        """Return a list to which the messages of a topic are appended."""
        messages: list[Any] = []
        self.peer.create_subscription(kind, topic, messages.append, profile)
        return messages

    def until(self, happened: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        spin_until(self.executor, happened, act)

    def call(self, name: str, kind: Any = Trigger, **request: Any) -> Any:
        client = self.peer.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = client.call_async(kind.Request(**request))
        self.until(answer.done)
        return answer.result()

    def set(self, node: str, name: str, value: Any) -> Any:
        given = [Parameter(name, value=value).to_parameter_msg()]
        return self.call(f"{node}/set_parameters", SetParameters, parameters=given).results[0]

    def close(self) -> None:
        for node in self.executor.get_nodes():
            getattr(node, "close", lambda: None)()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
        self._stack.close()
