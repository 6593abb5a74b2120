# SPDX-License-Identifier: Apache-2.0
"""Monitors the graph of the real-time bench: the time of its data, and what the nodes wait for before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from atpid_interfaces.msg import Event, Excitation
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from atpid_common.nodes.messages import EVENTS, STATES, nanoseconds_of
from atpid_common.waiting import COMPILING

ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class BenchWatch(Node):
    """Follows the estimates' stamps, the events and, until the first estimate, the log; it publishes nothing."""

    def __init__(self, report: Callable[[str], None], **node_options: Any) -> None:
        """Subscribe. `report` is called with each warning, and with what is compiled, before the first estimate."""
        super().__init__("bench_watch", **node_options)
        self.elapsed = 0.0  # data time since the first estimate [s]
        self.failure = ""  # why the plant failed, one sentence
        self._report = report
        self._reported: set[str] = set()
        self._first: int | None = None
        self.create_subscription(Excitation, "excitation", self._on_excitation, STATES)
        self.create_subscription(Event, "events", self._on_event, EVENTS)
        self.create_subscription(Log, "/rosout", self._on_log, ROSOUT)

    def _on_excitation(self, message: Excitation) -> None:
        if message.handshake:
            return
        now = nanoseconds_of(message.header.stamp)
        self._first = self._first or now
        self.elapsed = (now - self._first) * 1e-9

    def _on_event(self, event: Event) -> None:
        if event.kind == Event.FAILED:
            self.failure = event.text

    def _on_log(self, log: Log) -> None:
        text = f"{log.name}: {log.msg}"
        relevant = log.level >= Log.WARN or log.msg.startswith(COMPILING)
        if relevant and self._first is None and text not in self._reported:
            self._reported.add(text)
            self._report(text)


@contextmanager
def watching(report: Callable[[str], None], namespace: str = "") -> Iterator[tuple[BenchWatch, Callable[[], None]]]:
    """Yield the watch and a function that spins it for up to a tenth of a second."""
    rclpy.init(args=["--ros-args", "--disable-stdout-logs"], signal_handler_options=SignalHandlerOptions.NO)
    try:
        watch = BenchWatch(report, namespace=namespace)
        executor = SingleThreadedExecutor()
        executor.add_node(watch)
        yield watch, lambda: executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
        watch.destroy_node()
    finally:
        rclpy.try_shutdown()
