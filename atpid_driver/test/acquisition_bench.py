# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS context of its own in a test, and a node that subscribes to the topics of a source."""

import os
from collections.abc import Callable
from typing import Any, TypeVar

import rclpy
from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.srv import GetState
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.messages import STATUS
from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import spin_until

N = TypeVar("N", bound=Node)


class Bench:
    """One context and executor, with a node that subscribes to the topics of a source."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.executor = TurnExecutor(context=self.context)
        self.peer = Node("peer", context=self.context)
        self.blocks: list[SampleBlock] = []
        self.handshakes: list[SampleBlock] = []
        self.events: list[Event] = []
        self.diagnostics: list[Any] = []
        self.channels: dict[str, Any] = {}  # the last status of each channel
        for topic in ("sensors/laser", "sensors/accelerometer"):
            self.peer.create_subscription(SampleBlock, topic, self._on_block, 1000)
        self.peer.create_subscription(Event, "events", self.events.append, 100)
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.state = self.peer.create_publisher(CeilingState, "ceiling/state", 100)
        self.recorder = self.peer.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self.executor.add_node(self.peer)
        self.nodes: list[Node] = []

    def _on_block(self, block: SampleBlock) -> None:
        (self.handshakes if block.handshake else self.blocks).append(block)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.diagnostics.append(array.status[0])
        self.channels |= {status.name.split(": ")[1]: status for status in array.status[1:]}

    def start(self, kind: type[N], **values: object) -> N:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node: N = kind(context=self.context, parameter_overrides=overrides)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def until(self, what: Callable[[], object]) -> None:
        spin_until(self.executor, what)

    def has_event(self, part: str) -> bool:
        return any(part in event.text for event in self.events)

    def faults(self) -> list[str]:
        return [event.text for event in self.events if event.kind == Event.FAULT]

    def recovered(self) -> bool:
        return any(event.kind == Event.RECOVERED for event in self.events)

    @property
    def status(self) -> DiagnosticStatus:
        """The last status of the device; before there is any, an empty one."""
        return self.diagnostics[-1] if self.diagnostics else DiagnosticStatus()

    def lifecycle(self, node: Node) -> str:
        """Return a node's state, as its service has it."""
        client = self.peer.create_client(GetState, f"{node.get_name()}/get_state")
        self.until(client.service_is_ready)
        future = client.call_async(GetState.Request())
        self.until(future.done)
        self.peer.destroy_client(client)
        return str(future.result().current_state.label)

    def close(self) -> None:
        for node in [*self.nodes, self.peer]:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
