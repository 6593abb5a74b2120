# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Silence is an event within the time-out, and so is its end; before the first message and after a run it is right."""

from collections.abc import Iterator
from contextlib import closing

import pytest
from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from spun import Spun
from std_msgs.msg import Empty

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import EVENTS, time_of
from atpid_common.nodes.supervision import NodeMonitors

TIMEOUT = 0.2


class Stand(Spun):
    """A supervised node that subscribes to `estimates`, and a peer that publishes them and receives what it reports."""

    def __init__(self, *, enabled: bool = True) -> None:
        super().__init__("tested", "peer")
        self.silences, self.received, self.ticks = 0, 0, 0
        self.events: list[Event] = []
        self.statuses: list[DiagnosticStatus] = []
        publish = EventPublisher(self.node).publish
        self.supervision = NodeMonitors(self.node, publish, list, TIMEOUT, self._on_silence, enabled=enabled)
        self.monitor = self.supervision.stale
        self.monitor.watch("estimates", "uncontrolled")
        self.supervision.follow_events()
        self.node.create_subscription(Empty, "estimates", self._on_estimate, 10)
        self.peer.create_subscription(Event, "events", self.events.append, EVENTS)
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.estimates = self.peer.create_publisher(Empty, "estimates", 10)
        self.runs = self.peer.create_publisher(Event, "events", EVENTS)
        self.peer.create_timer(TIMEOUT, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.until(self.estimates.get_subscription_count)
        self.until(lambda: self.peer.count_publishers("/diagnostics") == enabled)
        self.until(lambda: self.runs.get_subscription_count() == 1 + enabled)

    def send(self) -> None:
        """Publish one estimate and wait until it has been received."""
        before = self.received
        self.estimates.publish(Empty())
        self.until(lambda: self.received > before)

    def let_time_pass(self) -> None:
        end = self.ticks + 5
        self.until(lambda: self.ticks >= end)

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events if event.kind != Event.FINISHED]

    def _tick(self) -> None:
        self.ticks += 1

    def _on_estimate(self, _: Empty) -> None:
        self.received += 1
        self.monitor.received("estimates")

    def _on_silence(self) -> None:
        self.silences += 1

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += [status for status in array.status if status.name == "tested: inputs"]


@pytest.fixture
def stand() -> Iterator[Stand]:
    with closing(Stand()) as made:
        yield made


def test_silence_and_its_end_are_events_and_in_the_diagnostics_at_once(stand: Stand) -> None:
    stand.let_time_pass()
    assert stand.kinds() == []  # before the first message
    stand.send()
    stand.until(lambda: stand.events)
    (stale,) = stand.events
    assert (stale.kind, stale.severity, stale.node) == (Event.STALE, Event.ALARM, "tested")
    assert stale.value >= TIMEOUT
    assert all(part in stale.text for part in ("estimates", f"{stale.value:.2f} s", "uncontrolled"))
    stand.until(lambda: any(status.level == DiagnosticStatus.STALE for status in stand.statuses))
    assert "estimates" in stand.statuses[-1].message
    stand.let_time_pass()
    assert stand.kinds() == [Event.STALE], "reported once"
    stand.send()
    stand.until(lambda: len(stand.events) >= 2)
    resumed = stand.events[1]
    assert (resumed.kind, resumed.severity) == (Event.RESUMED, Event.INFO)
    assert resumed.value >= stale.value + 4.0 * TIMEOUT
    assert stand.silences >= 2


def test_silence_after_the_end_of_a_run_is_right(stand: Stand) -> None:
    stand.send()
    finished = Event(kind=Event.FINISHED)
    finished.header.stamp = time_of(1_000_000_000)
    stand.runs.publish(finished)
    stand.until(lambda: not stand.monitor.running)
    before = stand.kinds().count(Event.STALE)  # of a machine too busy for the end to come in time
    stand.let_time_pass()
    assert stand.kinds().count(Event.STALE) == before
    for stamp_ns in (None, 950_000_000, 1_000_000_001):  # the answers to its last samples come after the event
        stand.monitor.received("estimates", stamp_ns)
        assert not stand.monitor.running
    stand.monitor.received("estimates", 1_050_000_000)
    stand.until(lambda: stand.kinds().count(Event.STALE) > before)


def test_messages_queued_while_the_process_was_held_up_are_received_first(stand: Stand) -> None:
    stand.send()
    stand.executor.remove_node(stand.node)
    stand.let_time_pass()
    stand.estimates.publish(Empty())
    stand.until(stand.estimates.wait_for_all_acked)
    stand.executor.add_node(stand.node)
    stand.until(lambda: stand.received == 2)
    assert stand.monitor.stale == []
    assert stand.kinds() == []


def test_three_missing_messages_are_silence_where_they_are_rare(stand: Stand) -> None:
    stand.send()
    stand.monitor.received("estimates", period=5.0 * TIMEOUT)
    stand.let_time_pass()
    assert stand.kinds() == []


def test_in_lockstep_nothing_is_reported() -> None:
    with closing(Stand(enabled=False)) as stand:
        stand.send()
        stand.let_time_pass()
        assert stand.kinds() == []
