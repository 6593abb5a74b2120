# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS context of its own in a test, and a node that subscribes to the topics of a source."""

from typing import Any, TypeVar

from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.srv import GetState
from rclpy.node import Node
from spun import Spun

from atpid_common.nodes.messages import STATUS

N = TypeVar("N", bound=Node)


class Bench(Spun):
    """One context and executor, with a node that subscribes to the topics of a source."""

    def __init__(self) -> None:
        super().__init__("peer")
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

    def _on_block(self, block: SampleBlock) -> None:
        (self.handshakes if block.handshake else self.blocks).append(block)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.diagnostics.append(array.status[0])
        self.channels |= {status.name.split(": ")[1]: status for status in array.status[1:]}

    def start(self, kind: type[N], **values: object) -> N:
        node: N = self.make(kind, values)
        return node

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
        return str(self.call(f"{node.get_name()}/get_state", GetState).current_state.label)
