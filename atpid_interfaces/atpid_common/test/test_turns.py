# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The executor of the nodes calls all that rclpy's calls, and makes the set that it waits on once."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from atpid_interfaces.action import SearchHeight
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from atpid_common.interrupt import Interrupt, waking
from atpid_common.nodes.turns import TurnExecutor

pytestmark = pytest.mark.slow

MANY = 20


class Pair:
    """A node under test and its peer on one executor."""

    def __init__(self, gather: float = 0.0) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(gather, context=self.context)
        self.node, self.peer = (Node(name, context=self.context) for name in ("tested", "peer"))
        self.numbers = self.peer.create_publisher(Int32, "numbers", MANY)
        self.received: list[int] = []
        for node in (self.node, self.peer):
            self.executor.add_node(node)

    def subscribe(self) -> Any:
        made = self.node.create_subscription(Int32, "numbers", lambda number: self.received.append(number.data), MANY)
        self.until(self.numbers.get_subscription_count)
        return made

    def until(self, met: Callable[[], Any]) -> None:
        end = time.monotonic() + 100.0
        while not met():
            assert time.monotonic() < end, "what was waited for did not come"
            self.executor.spin_once(timeout_sec=0.05)

    def publish_many(self) -> None:
        """Publish numbers from 0 on, each of which is there before anything is called."""
        for number in range(MANY):
            self.numbers.publish(Int32(data=number))
        assert self.numbers.wait_for_all_acked(rclpy.duration.Duration(seconds=100.0))

    def close(self) -> None:
        for node in (self.node, self.peer):
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair()
    yield made
    made.close()


def steady() -> Clock:
    return Clock(clock_type=ClockType.STEADY_TIME)


def test_each_message_is_received_once_and_in_order(pair: Pair) -> None:
    pair.subscribe()
    pair.publish_many()
    pair.until(lambda: len(pair.received) == MANY)
    assert pair.received == list(range(MANY))


def test_the_set_that_is_waited_on_is_not_made_for_each_callback(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    pair.subscribe()
    made: list[object] = []
    original = rclpy_implementation.WaitSet

    def counted(*arguments: Any) -> Any:
        made.append(arguments)
        return original(*arguments)

    monkeypatch.setattr(rclpy_implementation, "WaitSet", counted)
    pair.publish_many()
    pair.node.create_timer(0.001, lambda: pair.received.append(-1), clock=steady())
    pair.until(lambda: len(pair.received) > 2 * MANY)
    # for the timer, and by rclpy's look for the middleware's events; rclpy makes two for each callback
    assert len(made) < MANY


def test_gathered_messages_take_one_turn() -> None:
    pair = Pair(gather=0.01)
    pair.subscribe()
    pair.publish_many()
    while not pair.received:
        pair.executor.spin_once(timeout_sec=0.05)
    assert pair.received == list(range(MANY))
    pair.close()


def test_a_slow_callback_does_not_keep_gathered_messages_from_the_timers() -> None:
    pair, gather = Pair(gather=0.01), 0.01
    order: list[str] = []

    def slow(_: Int32) -> None:
        order.append("message")
        time.sleep(2.0 * gather)

    pair.node.create_subscription(Int32, "numbers", slow, MANY)
    pair.until(pair.numbers.get_subscription_count)
    pair.publish_many()
    pair.node.create_timer(0.001, lambda: order.append("timer"), clock=steady())
    pair.until(lambda: order.count("message") == MANY)
    assert "message message" not in " ".join(order)
    pair.close()


@pytest.mark.parametrize("how", ["cancel", "destroy"])
def test_a_timer_that_another_callback_ends_is_not_called(pair: Pair, how: str) -> None:
    ends: list[Callable[[], object]] = []
    called: list[str] = []

    def end(name: str) -> Callable[[], None]:
        def act() -> None:
            called.append(name)
            ends.pop()()

        return act

    timers = [pair.node.create_timer(0.01, end(name), clock=steady()) for name in ("first", "second")]
    if how == "cancel":
        ends += [timers[0].cancel, timers[1].cancel]
    else:
        ends += [lambda: pair.node.destroy_timer(timers[0]), lambda: pair.node.destroy_timer(timers[1])]
    # both are due when the first is called, which ends the second
    time.sleep(0.02)
    pair.executor.spin_once(timeout_sec=1.0)
    assert set(called) == {"first"}  # on a busy machine the first is due again
    pair.executor.spin_once(timeout_sec=0.05)
    assert "second" not in called


def test_a_topic_that_its_own_callback_ends_is_over(pair: Pair) -> None:
    def first(number: Int32) -> None:
        pair.received.append(number.data)
        pair.node.destroy_subscription(subscription)

    subscription = pair.node.create_subscription(Int32, "numbers", first, MANY)
    pair.until(pair.numbers.get_subscription_count)
    pair.publish_many()
    pair.until(lambda: pair.received)
    pair.executor.spin_once(timeout_sec=0.05)
    assert pair.received == [0]


def test_a_service_that_waits_answers_when_it_can_and_holds_nothing_up(pair: Pair) -> None:
    computed: Future = Future()

    async def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = await computed
        return response

    pair.node.create_service(Trigger, "wait", answer, callback_group=ReentrantCallbackGroup())
    client = pair.peer.create_client(Trigger, "wait")
    pair.until(client.service_is_ready)
    pair.subscribe()
    asked, answers = client.call_async(Trigger.Request()), list[str]()
    asked.add_done_callback(lambda done: answers.append(done.result().message))
    pair.publish_many()
    pair.until(lambda: len(pair.received) == MANY)
    assert answers == []
    pair.node.create_timer(0.01, lambda: computed.set_result("computed"), clock=steady())
    pair.until(lambda: answers)
    assert answers == ["computed"]


def test_a_guard_condition_and_a_task_of_another_thread_are_called(pair: Pair) -> None:
    called: list[str] = []
    guard = pair.node.create_guard_condition(lambda: called.append("guard"))
    pair.executor.spin_once(timeout_sec=0.0)
    guard.trigger()
    pair.until(lambda: called)
    pair.executor.create_task(lambda: called.append("task"))
    pair.until(lambda: called == ["guard", "task"])


def test_an_action_is_served(pair: Pair) -> None:
    def execute(goal: Any) -> SearchHeight.Result:
        goal.succeed()
        return SearchHeight.Result(success=True, message="done")

    server = ActionServer(pair.node, SearchHeight, "search", execute)
    client: ActionClient = ActionClient(pair.peer, SearchHeight, "search")
    pair.until(client.server_is_ready)
    accepted = client.send_goal_async(SearchHeight.Goal())
    pair.until(accepted.done)
    result = accepted.result().get_result_async()
    pair.until(result.done)
    assert result.result().result.message == "done"
    client.destroy()
    server.destroy()


def test_what_the_middleware_reports_is_called(pair: Pair) -> None:
    reported: list[Any] = []
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    pair.node.create_subscription(
        Int32, "other", lambda _: None, reliable,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=reported.append),
    )  # fmt: skip
    pair.peer.create_publisher(Int32, "other", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    pair.until(lambda: reported)
    assert reported[0].total_count == 1


def test_what_a_callback_raises_ends_the_spinning(pair: Pair) -> None:
    def fail() -> None:
        raise ArithmeticError("of a callback")

    pair.node.create_timer(0.001, fail, clock=steady())
    with pytest.raises(ArithmeticError, match="of a callback"):
        pair.until(lambda: False)


def test_a_callback_that_awaits_goes_on_when_what_it_awaits_is_there(pair: Pair) -> None:
    answer = Future()
    order: list[str] = []

    async def asked() -> None:
        timer.cancel()
        order.append("asked")
        order.append(await answer)

    timer = pair.node.create_timer(0.01, asked, clock=steady())
    pair.until(lambda: order)
    assert order == ["asked"]
    answer.set_result("answered")
    pair.until(lambda: len(order) == 2)
    assert order == ["asked", "answered"]


def test_a_signal_ends_the_wait_at_once(pair: Pair) -> None:
    """Without anything that wakes the executor Python would call the handler after the wait of 100 s."""
    for node in (pair.node, pair.peer):
        pair.executor.remove_node(node)
    with Interrupt() as interrupt, waking(pair.executor.wake):
        interrupt.defer()
        begun = time.monotonic()
        sent = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
        sent.start()
        while not interrupt.received:
            pair.executor.spin_once(timeout_sec=100.0)
        sent.join()
    assert time.monotonic() - begun < 50.0
