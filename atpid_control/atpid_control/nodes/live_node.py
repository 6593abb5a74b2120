# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves the live page (docs/live.md): receives what the graph publishes, and calls its services for the operator.

A process of its own with a low priority. No node waits for it: what it cannot take in time is not sent again.
"""

import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    Excitation,
    PlantTruth,
    RecorderStatus,
    SampleBlock,
    SupervisorState,
)
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import TOPIC as DIAGNOSTICS
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import EVENTS_KEPT, STATUS
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import Entry, declare
from atpid_control.nodes.operator_requests import OperatorRequests
from atpid_control.selection.registry import methods
from atpid_control.views.live.address import HOST, PORT, TOKEN, address_of, require_library
from atpid_control.views.live.view import LiveView
from atpid_sim.scene import load_scene

PARAMETERS = (
    Entry("scene", "", "scene file, for the efficiency and the size of the grain; empty: neither is shown"),
    Entry("host", HOST, "address to serve the page on; another than the loopback needs a token"),
    Entry("port", PORT, "TCP port of the page; 0: a free one", "", 0, 65535),
)
#: What is not received in time is not needed: an eighth of a second of the most frequent topic.
NEWEST = QoSProfile(depth=6, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Nice value of the process: every node of the loop comes first.
NICE = 10


class LiveNode(Node):
    """Parameters, topics, and one call into the view for each message."""

    def __init__(self, **node_options: Any) -> None:
        """Serve the page. Raises LiveError, ParameterError or SceneError, in one line."""
        super().__init__("live_node", **node_options)
        values = declare(self, PARAMETERS)
        require_library()
        from atpid_control.views.live.server import LiveServer  # needs the library

        address = address_of(values["host"], values["port"])
        self.view = LiveView(load_scene(values["scene"]) if values["scene"] else None)
        self._events = EventPublisher(self)
        requests = OperatorRequests(self, self._events)
        self._receive()
        self.server = LiveServer(self.view, requests.do, address, methods())

    def _receive(self) -> None:
        view = self.view
        for topic, kind, take in (
            ("sensors/laser", SampleBlock, view.on_block),
            ("plant/truth", PlantTruth, view.on_truth),
            ("excitation", Excitation, view.on_excitation),
            ("ceiling/command", CeilingCommand, partial(view.on_state, "ceiling/command")),
            ("ceiling/state", CeilingState, partial(view.on_state, "ceiling/state")),
            ("supervisor/state", SupervisorState, partial(view.on_state, "supervisor/state")),
        ):
            subscribe(self, kind, topic, partial(_pass_on, take), NEWEST)
        subscribe(self, Event, "events", partial(_pass_on, view.on_event), EVENTS_KEPT)
        recorder = partial(view.on_state, "recorder/status")
        subscribe(self, RecorderStatus, "recorder/status", partial(_pass_on, recorder), STATUS)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, partial(_pass_on, view.on_diagnostics), NEWEST)

    def close(self) -> None:
        """End the page."""
        self.server.close()


def _pass_on(take: Callable[[Any, float], None], message: Any) -> None:
    """Pass a message to the view with the steady time; handshakes carry nothing."""
    if not getattr(message, "handshake", False):
        take(message, time.monotonic())


def _announced() -> LiveNode:
    """Make the node and print the page's address; who gave the token has printed it."""
    node = LiveNode()
    address = node.server.address
    if not address.token or os.environ.get(TOKEN, "") != address.token:
        print(f"live page: {address.url}", flush=True)
    return node


def main(args: Sequence[str] | None = None) -> int:
    """Run the live page as a process of its own, with a low priority; return the exit status."""
    os.nice(NICE)
    return run_node(_announced, args)


if __name__ == "__main__":
    sys.exit(main())
