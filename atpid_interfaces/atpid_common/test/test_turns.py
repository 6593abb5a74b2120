# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The executor of the nodes calls all that rclpy's calls, and makes the set that it waits on once."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import pairwise
from typing import Any

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from spun import Spun
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from atpid_common.interrupt import Interrupt, waking
from atpid_common.testing import PATIENCE

MANY = 20
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class Numbers(Spun):
    """Its peer publishes numbers; its node receives them, by `act` where that is given."""

    def __init__(self, gather: float = 0.0) -> None:
        super().__init__("tested", "peer", gather=gather)
        self.publisher = self.peer.create_publisher(Int32, "numbers", MANY)
        self.received: list[int] = []

    def subscribe(self, act: Callable[[Int32], None] = lambda _: None) -> Any:
        def receive(number: Int32) -> None:
            self.received.append(number.data)
            act(number)

        made = self.node.create_subscription(Int32, "numbers", receive, MANY)
        self.until(self.publisher.get_subscription_count)
        return made

    def publish_many(self) -> None:
        """Publish numbers from 0 on, each of which is there before anything is called."""
        for number in range(MANY):
            self.publisher.publish(Int32(data=number))
        assert self.publisher.wait_for_all_acked(Duration(seconds=PATIENCE))

    def after(self, seconds: float, act: Callable[[], Any]) -> Any:
        return self.node.create_timer(seconds, act, clock=STEADY)


@pytest.fixture
def pair() -> Iterator[Numbers]:
    with closing(Numbers()) as made:
        yield made


def test_messages_come_once_and_in_order_from_a_set_made_once(pair: Numbers, monkeypatch: pytest.MonkeyPatch) -> None:
    pair.subscribe()
    made: list[object] = []
    original = rclpy_implementation.WaitSet

    def counted(*arguments: Any) -> Any:
        made.append(arguments)
        return original(*arguments)

    monkeypatch.setattr(rclpy_implementation, "WaitSet", counted)
    pair.publish_many()
    pair.after(0.001, lambda: pair.received.append(-1))
    pair.until(lambda: pair.received.count(-1) > MANY and len(pair.received) > 2 * MANY)
    assert [number for number in pair.received if number >= 0] == list(range(MANY))
    # for the timer, and by rclpy's look for the middleware's events; rclpy makes two for each callback
    assert len(made) < MANY


def test_gathered_messages_take_one_turn() -> None:
    with closing(Numbers(gather=0.3)) as gathering:
        gathering.subscribe()
        gathering.publish_many()
        gathering.until(lambda: gathering.received)
        assert gathering.received == list(range(MANY))


def test_a_slow_callback_does_not_keep_gathered_messages_from_the_timers() -> None:
    with closing(Numbers(gather=0.01)) as gathering:
        received = gathering.received
        gathering.subscribe(lambda _: time.sleep(0.02))
        gathering.publish_many()
        gathering.after(0.001, lambda: received.append(-1))
        gathering.until(lambda: len(received) - received.count(-1) == MANY)
        assert all(-1 in neighbours for neighbours in pairwise(received))


@pytest.mark.parametrize("how", ["cancel", "destroy"])
def test_a_timer_that_another_callback_ends_is_not_called(pair: Numbers, how: str) -> None:
    called: list[str] = []

    def end(own: str, other: str) -> None:
        called.append(own)
        if how == "cancel":
            timers[other].cancel()
        else:
            pair.node.destroy_timer(timers[other])

    timers = {"first": pair.after(0.01, lambda: end("first", "second"))}
    timers["second"] = pair.after(0.01, lambda: end("second", "first"))
    # both are due when one is called, which ends the other
    time.sleep(0.02)
    pair.until(lambda: called)
    pair.executor.spin_once(timeout_sec=0.05)
    assert set(called) == {"first"}  # on a busy machine it is due again


def test_a_topic_that_its_own_callback_ends_is_over(pair: Numbers) -> None:
    subscription = pair.subscribe(lambda _: pair.node.destroy_subscription(subscription))
    pair.publish_many()
    pair.until(lambda: pair.received)
    pair.executor.spin_once(timeout_sec=0.05)
    assert pair.received == [0]


def test_a_service_that_waits_answers_when_it_can_and_holds_nothing_up(pair: Numbers) -> None:
    computed: Future = Future()

    async def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = await computed
        return response

    pair.node.create_service(Trigger, "wait", answer, callback_group=ReentrantCallbackGroup())
    client = pair.peer.create_client(Trigger, "wait")
    pair.until(client.service_is_ready)
    pair.subscribe()
    asked = client.call_async(Trigger.Request())
    pair.publish_many()
    pair.until(lambda: len(pair.received) == MANY)
    assert not asked.done()
    pair.after(0.01, lambda: computed.set_result("computed"))
    pair.until(asked.done)
    assert asked.result().message == "computed"


def test_a_guard_condition_a_task_and_what_the_middleware_reports_are_called(pair: Numbers) -> None:
    called: list[Any] = []
    guard = pair.node.create_guard_condition(lambda: called.append("guard"))
    pair.executor.spin_once(timeout_sec=0.0)
    guard.trigger()
    pair.until(lambda: called)
    pair.executor.create_task(lambda: called.append("task"))
    pair.until(lambda: len(called) > 1)
    callbacks = SubscriptionEventCallbacks(incompatible_qos=lambda event: called.append(event.total_count))
    pair.node.create_subscription(Int32, "other", lambda _: None, 1, event_callbacks=callbacks)
    pair.peer.create_publisher(Int32, "other", qos_profile_sensor_data)
    pair.until(lambda: called == ["guard", "task", 1])


def test_what_a_callback_raises_ends_the_spinning(pair: Numbers) -> None:
    pair.after(0.001, lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        pair.until(lambda: False)


def test_a_signal_ends_the_wait_at_once(pair: Numbers) -> None:
    """Without anything that wakes the executor Python would call the handler after the wait of 1000 s."""
    for node in (pair.node, pair.peer):
        pair.executor.remove_node(node)
    with Interrupt() as interrupt, waking(pair.executor.wake):
        interrupt.defer()
        sent = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
        sent.start()
        while not interrupt.received:
            pair.executor.spin_once(timeout_sec=1000.0)  # beyond what a test may take
        sent.join()
