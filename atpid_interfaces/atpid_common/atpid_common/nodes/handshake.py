# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The handshake of a source of samples: an empty message passes through every node before the first sample.

Discovery takes seconds and is not symmetric; without a handshake the first seconds of data are lost. Messages of the
handshake are marked by their field `handshake` and are never recorded. Discovery may lose requests to a service, too:
`Question` makes one again where no answer comes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    Excitation,
    PlantTruth,
    RecorderStatus,
    SampleBlock,
)
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.nodes.messages import STEADY

M = TypeVar("M", CeilingState, Event, PlantTruth, SampleBlock)
PERIOD = 0.05  # between two messages of the handshake [s]
ANNOUNCE_AFTER, ANNOUNCE_AGAIN = 2.0, 10.0  # until what is missing is logged, and logged again [s]
LOOP_TOPICS = ("events", "excitation", "ceiling/command", "ceiling/state")
#: The nodes that answer one after the other until the topic's message comes.
_ANSWERED_BY = {
    "excitation": ("identifier_node",),
    "ceiling/command": ("identifier_node", "selector_node"),
    "ceiling/state": ("identifier_node", "selector_node", "motor_node"),
}


def empty(kind: type[M]) -> M:
    """Return the handshake's message of a type: no data, stamp 0."""
    message = kind()
    message.handshake = True
    return message


def empty_block(channels: Sequence[str], units: Sequence[str]) -> SampleBlock:
    """Return the handshake's block: the channels, no scans."""
    message = empty(SampleBlock)
    message.channels, message.units = list(channels), list(units)
    return message


class Handshake:
    """Publishes until the loop has answered and the recorder has received every topic, then calls `ready` once.

    The node passes the messages it receives to `on_answer` and `on_status`.
    """

    def __init__(
        self,
        node: Node,
        publish: Callable[[], None],
        ready: Callable[[], None],
        *,
        topics: Sequence[str],
        answer: str = "ceiling/state",
        recorder: bool,
        blocked: Callable[[], str] = str,
    ) -> None:
        """Begin.

        publish: publishes one message of the handshake on each topic of the source.
        topics: what the recorder must have received, where `recorder` is true; those it does not record do not count.
        answer: topic of the message that answers; empty: nothing answers this source.
        blocked: returns what else stands in the way, in words; empty: nothing.
        """
        self._node, self._publish, self._ready = node, publish, ready
        self._topics, self._answer, self._expect_recorder = tuple(topics), answer, recorder
        self._blocked = blocked
        self.active, self.answered = True, not answer
        self._status: RecorderStatus | None = None
        self._announce_at = time.monotonic() + ANNOUNCE_AFTER
        self._timer = node.create_timer(PERIOD, self._turn, clock=STEADY)

    def on_answer(self, message: CeilingCommand | CeilingState | Excitation) -> None:
        """Take a message of the answering topic; only one of the handshake counts."""
        self.answered = self.answered or message.handshake

    def on_status(self, status: RecorderStatus) -> None:
        """Take the recorder's status."""
        self._status = status

    def waiting_for(self) -> str:
        """Return what is still missing, in words; empty: nothing."""
        if problem := self._blocked():
            return problem
        if not self.answered:
            return f"an answer on {self._answer}{self._answering()}"
        if not self._expect_recorder:
            return ""
        status, resolve = self._status, self._node.resolve_topic_name
        if status is None:
            return "recorder_node (recorder/status)"
        if not status.recording:
            return f"a recorder with an open bag; that of {status.bag} is closed, start another one"
        received = dict(zip(map(resolve, status.topics), status.received, strict=False))
        missing = [topic for topic in self._topics if received.get(resolve(topic), 1) == 0]
        return f"the recorder to receive {', '.join(missing)}" if missing else ""

    def cancel(self) -> None:
        """End the handshake; a second time does nothing."""
        if self.active:
            self.active = False
            self._node.destroy_timer(self._timer)

    def _turn(self) -> None:
        self._publish()
        if not self.active:  # given up while publishing
            return
        missing = self.waiting_for()
        if not missing:
            self.cancel()
            self._ready()
        elif time.monotonic() > self._announce_at:
            self._announce_at = time.monotonic() + ANNOUNCE_AGAIN
            self._node.get_logger().warning(f"no samples yet: waiting for {missing}")

    def _answering(self) -> str:
        """Return in words which of the answering nodes discovery does not show, or who they are."""
        nodes, running = _ANSWERED_BY.get(self._answer, ()), self._node.get_node_names()
        absent = [name for name in nodes if name not in running]
        return f"; not running: {', '.join(absent)}" if absent else f" of {', then '.join(nodes)}" if nodes else ""


#: Until a request without an answer is made again [s].
_AGAIN = 0.5


class Question:
    """One request at a time to another node's service, made again where no answer comes."""

    def __init__(self, client: Client, answered: Callable[..., None]) -> None:
        """Take the service's client; `answered` is called with each answer, not with that of a request made again."""
        self._client, self._answered = client, answered
        self._asked, self._pending = -math.inf, False
        self._future = Future()

    def ask(self, request: object, now: float, period: float = 0.0) -> None:
        """Make the request at the steady time `now` [s], unless it is too soon.

        That is less than `period` [s] after the last one, or `AGAIN` where that has no answer.
        """
        wait = _AGAIN if self._pending else period
        if now - self._asked < wait or not self._client.service_is_ready():
            return
        self._client.remove_pending_request(self._future)
        self._asked, self._pending = now, True
        self._future = self._client.call_async(request)
        self._future.add_done_callback(self._done)

    def _done(self, future: Future) -> None:
        if future is self._future and future.exception() is None:
            self._pending = False
            self._answered(future.result())
