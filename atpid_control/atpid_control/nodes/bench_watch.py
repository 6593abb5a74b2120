# SPDX-License-Identifier: Apache-2.0
"""What the real-time bench sees of its graph: how far the data are, and what the nodes have to say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from atpid_interfaces.msg import Event, Excitation
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from atpid_common.nodes.messages import EVENTS, STATES, nanoseconds_of


class BenchWatch(Node):
    """Follows the estimates' stamps and the events; it sends nothing."""

    def __init__(self, **node_options: Any) -> None:
        """Subscribe."""
        super().__init__("bench_watch", **node_options)
        self.elapsed = 0.0  # data time since the first estimate [s]
        self.failure = ""  # what the plant said when it failed
        self._first: int | None = None
        self.create_subscription(Excitation, "excitation", self._on_excitation, STATES)
        self.create_subscription(Event, "events", self._on_event, EVENTS)

    def _on_excitation(self, message: Excitation) -> None:
        if message.handshake:
            return
        now = nanoseconds_of(message.header.stamp)
        self._first = self._first or now
        self.elapsed = (now - self._first) * 1e-9

    def _on_event(self, event: Event) -> None:
        if event.kind == Event.FAILED:
            self.failure = event.text


@contextmanager
def watching() -> Iterator[tuple[BenchWatch, Callable[[], None]]]:
    """Give the watch and a function that lets it listen for up to a tenth of a second."""
    rclpy.init(args=["--ros-args", "--disable-stdout-logs"], signal_handler_options=SignalHandlerOptions.NO)
    try:
        watch = BenchWatch()
        executor = SingleThreadedExecutor()
        executor.add_node(watch)
        yield watch, lambda: executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
        watch.destroy_node()
    finally:
        rclpy.try_shutdown()
