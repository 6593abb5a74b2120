# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports topics without messages: an event and a diagnostic status within the time-out, and an event when they resume.

Monitoring begins with the first message that is no handshake and pauses at the end of a run. Time is that of the steady
clock; a loop in lockstep has no use for it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.timer import Timer

from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.messages import STEADY
from atpid_common.nodes.parameters import Publish

#: Last part of the time-out: what was queued while this process was held up is received in it [s].
GRACE = 0.05
#: Messages that may be missing one after the other before that is silence.
MISSING = 3
#: Stamps of one instant may differ by rounding [ns].
SAME_INSTANT = 10_000
#: Longest time-out, whatever the period [s]: that between the last block of a run and the first of the next is none.
LONGEST = 10.0


@dataclass
class _Topic:
    """One topic that is monitored."""

    name: str
    consequence: str
    timer: Timer
    last: float = 0.0  # steady time of the last message [s]
    waited: bool = False  # the time-out but for its last part is over
    stale: bool = False


class StaleMonitor:
    """Monitors topics of a node; a timer for each, which every message sets back."""

    def __init__(
        self, node: Node, publish: Publish, timeout: float, changed: Callable[[], None], *, enabled: bool
    ) -> None:
        """Monitor nothing yet.

        publish: publishes an event; timeout: silence that is reported [s]; changed: called after each report;
        enabled: false where time is not that of the wall (lockstep): then nothing is ever reported.
        """
        self._node, self._publish, self._changed = node, publish, changed
        self.timeout, self._enabled = timeout, enabled
        self._topics: dict[str, _Topic] = {}
        self._ended_ns: int | None = None  # stamp of the last sample of a run that has ended [ns]

    def watch(self, name: str, consequence: str) -> None:
        """Monitor a topic; `consequence` ends the event's text: what the node does without the messages."""
        if self._enabled:
            timer = self._node.create_timer(self.timeout, lambda: self._expired(self._topics[name]), clock=STEADY)
            timer.cancel()
            self._topics[name] = _Topic(name, consequence, timer)

    def received(self, name: str, stamp_ns: int | None = None, period: float = 0.0) -> None:
        """Record a message that is not of the handshake.

        stamp_ns: of the last sample it stands for [ns]; None: it stands for none. period: expected from one message to
        the next, where it is known [s]; three missing messages are silence where that is longer than the time-out.
        """
        if not self._enabled:
            return
        topic = self._topics[name]
        if self._ended_ns is not None and (stamp_ns is None or stamp_ns <= self._ended_ns + SAME_INSTANT):
            return  # of the run that has ended
        self._ended_ns = None
        silence, topic.last = time.monotonic() - topic.last, time.monotonic()
        topic.waited = False
        self._wait(topic.timer, max(self.timeout, min(MISSING * period, LONGEST)) - GRACE)
        if topic.stale:
            topic.stale = False
            self._publish(Event.INFO, Event.RESUMED, f"{name}: messages again after {silence:.2f} s", silence)
            self._changed()

    def end(self, stamp_ns: int) -> None:
        """Expect no further messages: a run has ended with the sample at `stamp_ns` [ns].

        Its last messages may still be on their way; the first with a later stamp begins anew.
        """
        self._ended_ns = stamp_ns
        self.cancel()

    def cancel(self) -> None:
        """Stop the timers."""
        for topic in self._topics.values():
            topic.stale = False
            topic.timer.cancel()

    @property
    def running(self) -> bool:
        """Whether messages are expected: one has come, and the run has not ended."""
        return any(topic.stale or not topic.timer.is_canceled() for topic in self._topics.values())

    @property
    def stale(self) -> list[str]:
        """Names of the topics without messages."""
        return [topic.name for topic in self._topics.values() if topic.stale]

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: inputs"."""
        now = time.monotonic()
        ages = {f"{topic.name} age [s]": f"{now - topic.last:.2f}" for topic in self._topics.values() if topic.last}
        if self.stale:
            text = f"no messages on {', '.join(self.stale)}"
            return status(self._node, "inputs", DiagnosticStatus.STALE, text, ages)
        return status(self._node, "inputs", DiagnosticStatus.OK, "all inputs arrive or are not expected", ages)

    def _expired(self, topic: _Topic) -> None:
        if not topic.waited:
            topic.waited = True
            self._wait(topic.timer, GRACE)
            return
        topic.timer.cancel()
        topic.stale = True
        silence = time.monotonic() - topic.last
        text = f"no message on {topic.name} for {silence:.2f} s: {topic.consequence}"
        self._publish(Event.ALARM, Event.STALE, text, silence)
        self._changed()

    def _wait(self, timer: Timer, seconds: float) -> None:
        period = round(seconds * 1e9)
        if timer.timer_period_ns != period:
            timer.timer_period_ns = period
        timer.reset()
