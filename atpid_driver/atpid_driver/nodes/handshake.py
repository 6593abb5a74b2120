# SPDX-License-Identifier: Apache-2.0
"""The handshake of a source: hello goes round the loop, and only when it came back does the first sample follow."""

from __future__ import annotations

import time
from collections.abc import Callable

from atpid_interfaces.msg import CeilingState, RecorderStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from atpid_driver.nodes.blocks import HELLO

PERIOD_S = 0.05
IMPATIENT_S = 5.0
LOOP_TOPICS = ("events", "excitation", "ceiling/command", "ceiling/state")
STATUS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Handshake:
    """Calls `say_hello` until all that is asked for has answered, then `done` once."""

    def __init__(
        self,
        node: LifecycleNode,
        own_topic: str,
        say_hello: Callable[[], None],
        done: Callable[[], None],
        *,
        loop: bool,
        recorder: bool,
    ) -> None:
        self._node, self._say_hello, self._done = node, say_hello, done
        self._loop, self._recorder = loop, recorder
        self._wanted = (own_topic, *(LOOP_TOPICS if loop else ()))
        self._answered = False
        self._status: RecorderStatus | None = None
        self._complain_at = time.monotonic() + IMPATIENT_S
        self._listeners = [
            node.create_subscription(CeilingState, "ceiling/state", self._on_state, 100),
            node.create_subscription(RecorderStatus, "recorder/status", self._on_status, STATUS),
        ]
        self._timer = node.create_timer(PERIOD_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def waiting_for(self) -> str:
        """What is still missing, in words; empty: nothing."""
        if self._loop and not self._answered:
            return "hello to come round on ceiling/state (identifier, selector and motor answer one after the other)"
        if self._recorder and self._status is None:
            return "the recorder's status"
        missing = self._unrecorded() if self._recorder else []
        return f"the recorder to receive {', '.join(missing)}" if missing else ""

    def cancel(self) -> None:
        """Stop saying hello."""
        self._timer.cancel()
        self._node.destroy_timer(self._timer)
        for listener in self._listeners:
            self._node.destroy_subscription(listener)
        self._listeners = []

    def _tick(self) -> None:
        self._say_hello()
        lacking = self.waiting_for()
        if not lacking:
            self.cancel()
            self._done()
        elif time.monotonic() > self._complain_at:
            self._complain_at = float("inf")
            self._node.get_logger().warning(f"not streaming yet, waiting for {lacking}")

    def _on_state(self, state: CeilingState) -> None:
        self._answered = self._answered or state.header.frame_id == HELLO

    def _on_status(self, status: RecorderStatus) -> None:
        self._status = status

    def _unrecorded(self) -> list[str]:
        """Of the topics that matter and the recorder subscribes to, those it has received nothing on."""
        assert self._status is not None
        resolve = self._node.resolve_topic_name
        received = dict(zip(map(resolve, self._status.topics), self._status.received, strict=True))
        return [topic for topic in self._wanted if received.get(resolve(topic), 1) == 0]
