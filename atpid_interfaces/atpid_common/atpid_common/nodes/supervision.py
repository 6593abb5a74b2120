# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The monitors of a node of the loop: silent inputs, quality of service, diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import nan
from typing import Any

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind
from rclpy.timer import Timer

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher, status
from atpid_common.nodes.messages import EVENTS, STEADY, nanoseconds_of
from atpid_common.nodes.parameters import Publish


class NodeMonitors:
    """The monitors of a node; whatever they report is in `/diagnostics` at once, and once a second."""

    def __init__(
        self,
        node: Node,
        publish: Publish,
        statuses: Callable[[], list[DiagnosticStatus]],
        stale_timeout: float,
        on_silence: Callable[[], None] = lambda: None,
        *,
        enabled: bool,
    ) -> None:
        """Begin.

        publish: publishes an event; statuses: returns the node's own statuses; stale_timeout: silence that is reported
        [s]; on_silence: called after an input has fallen silent or resumed; enabled: false in lockstep, where nothing
        depends on the clock of the wall.
        """
        self._node, self._statuses, self._on_silence, self._enabled = node, statuses, on_silence, enabled
        self._sources: set[str] = set()
        self.stale = StaleMonitor(node, publish, stale_timeout, self._silence, enabled=enabled)
        self.qos = QosMonitor(node, publish, self.report, enabled=enabled)
        self._diagnostics = DiagnosticsPublisher(node, self._all) if enabled else None

    def follow_events(self) -> None:
        """Subscribe to `events` for the end of a run; a node that subscribes by itself calls `on_event`."""
        if self._enabled:
            subscribe(self._node, Event, "events", self.on_event, EVENTS)

    def on_event(self, event: Event) -> None:
        """Expect no further messages after the end of a run, which counts from a source that announced its begin."""
        source = event.node
        if event.kind == Event.STARTED:
            self._sources.add(source)
        elif event.kind == Event.FINISHED and (not self._sources or source in self._sources):
            self.stale.end(nanoseconds_of(event.header.stamp))

    def report(self) -> None:
        """Publish diagnostics now: something has changed."""
        if self._diagnostics is not None:
            self._diagnostics.publish()

    def close(self) -> None:
        """Stop the timers."""
        self.stale.cancel()
        if self._diagnostics is not None:
            self._diagnostics.cancel()

    def _silence(self) -> None:
        self._on_silence()
        self.report()

    def _all(self) -> list[DiagnosticStatus]:
        return [*self._statuses(), self.stale.status(), self.qos.status()]


#: Last part of the time-out: what was queued while this process was held up is received in it [s].
_GRACE = 0.05
#: Messages that may be missing one after the other before that is silence.
MISSING = 3
#: Stamps of one instant may differ by rounding [ns].
_SAME_INSTANT = 10_000
#: Longest time-out, whatever the period [s]: that between the last block of a run and the first of the next is none.
_LONGEST = 10.0


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
    """Reports topics of a node without messages: within the time-out, and again when they resume.

    Monitoring begins with the first message that is no handshake and pauses at the end of a run. Each topic has a timer
    of the steady clock, which every message sets back; a loop in lockstep has no use for it.
    """

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
        if self._ended_ns is not None and (stamp_ns is None or stamp_ns <= self._ended_ns + _SAME_INSTANT):
            return  # of the run that has ended
        self._ended_ns = None
        silence, topic.last = time.monotonic() - topic.last, time.monotonic()
        topic.waited = False
        self._wait(topic.timer, max(self.timeout, min(MISSING * period, _LONGEST)) - _GRACE)
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
            self._wait(topic.timer, _GRACE)
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


class QosMonitor:
    """Reports what the middleware reports: incompatible quality of service, and deadlines that were missed.

    It makes the event callbacks of a node's publishers and subscriptions, and collects what they are called with.
    """

    def __init__(self, node: Node, publish: Publish, changed: Callable[[], None], *, enabled: bool) -> None:
        """Begin; publish: publishes an event; changed: called after each report; enabled: false in lockstep."""
        self._node, self._publish, self._changed, self._enabled = node, publish, changed, enabled
        self._incompatible: dict[str, str] = {}
        self._missed: dict[str, int] = {}

    def publisher(
        self, topic: str, deadline_counts: Callable[[], bool] | None = None
    ) -> PublisherEventCallbacks | None:
        """Return the callbacks of a publisher; None where nothing is to be reported.

        deadline_counts: for a publisher that offers a deadline, whether missing it means anything now: between two runs
        nothing is published.
        """
        if not self._enabled:
            return None
        missed = partial(self._on_missed, topic, deadline_counts) if deadline_counts is not None else None
        incompatible = partial(self._on_incompatible, topic, "subscription")
        return PublisherEventCallbacks(incompatible_qos=incompatible, deadline=missed)

    def subscription(self, topic: str) -> SubscriptionEventCallbacks | None:
        """Return the callbacks of a subscription; None where nothing is to be reported."""
        if not self._enabled:
            return None
        return SubscriptionEventCallbacks(incompatible_qos=partial(self._on_incompatible, topic, "publisher"))

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: quality of service"."""
        level = DiagnosticStatus.ERROR if self._incompatible else DiagnosticStatus.OK
        text = "; ".join(self._incompatible.values()) or "compatible"
        values = {f"{topic} deadlines missed": count for topic, count in self._missed.items()}
        return status(self._node, "quality of service", level, text, values)

    def _on_incompatible(self, topic: str, partner: str, event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower().removesuffix("_qos_policy")
        text = (
            f"{topic}: a {partner} has another {policy}, so that no message passes; "
            f"`ros2 topic info --verbose {self._node.resolve_topic_name(topic)}` shows both"
        )
        self._incompatible[topic] = text
        self._publish(Event.WARNING, Event.QOS, text, nan)
        self._changed()

    def _on_missed(self, topic: str, counts: Callable[[], bool], event: Any) -> None:
        """Count; the silence itself is an event of the nodes that do not receive the messages."""
        if counts():
            self._missed[topic] = self._missed.get(topic, 0) + event.total_count_change
            self._changed()
