# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search action over real DDS: feedback, cancel, and the reason of every end."""

import array
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from atpid_interfaces.action import SearchHeight
from atpid_interfaces.msg import SampleBlock
from numpy.typing import NDArray
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node

from atpid_common.nodes.messages import BLOCKS, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.protocol import ControlSettings, HeightCommand, LoopAnswer
from atpid_control.loop.search_run import SearchingController
from atpid_control.nodes.search_server import SearchServer

STEADY = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.49)
START = 1_700_000_000_000_000_000  # stamp of the first sample [ns]
GOAL = {"step": 0.1, "dwell": 2.0, "lowest": 0.1, "highest": 0.9}


class Inner:
    """A controller that has selected a height."""

    def answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        del time, estimate, height
        return LoopAnswer(HeightCommand(sequence=1, height=0.3))

    def on_event(self, kind: str) -> None:
        raise AssertionError(kind)

    def configure(self, settings: ControlSettings) -> None:
        raise AssertionError(settings)


class Stand:
    """A selector in small and a client, on one executor, with a beam whose amplitude is least at 0.52 m."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.node = Node("selector_node", context=self.context)
        self.client = Node("client", context=self.context)
        self.controller = SearchingController(Inner(), (0.017, 1.0))
        self.server = SearchServer(self.node, self.controller, lambda: START)
        self.actions = ActionClient(self.client, SearchHeight, "selector_node/search")
        self.blocks = self.client.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        for node in (self.node, self.client):
            self.executor.add_node(node)
        self.height, self.block, self.seen = 0.3, 0, 0.0
        watch = self.controller.watch

        def watched(time: float, beam: NDArray[np.float64]) -> None:
            self.seen = time
            watch(time, beam)

        self.controller.watch = watched  # type: ignore[method-assign]

    def wait(self, future: Any, act: Any = lambda: None) -> Any:
        end = time.monotonic() + 100.0
        while not future.done():
            assert time.monotonic() < end, "the answer waited for did not come"
            act()
            self.executor.spin_once(timeout_sec=0.02)
        return future.result()

    def turn(self) -> None:
        """One round of the loop: a block of the beam, an answered estimate, a ceiling that moves on."""
        message = SampleBlock(rate=1000.0, channels=["support_displacement", "beam_displacement"])
        message.header.stamp = time_of(START + self.block * 50_000_000)
        data = np.zeros((50, 2))
        times = 0.05 * self.block + np.arange(50) * 1e-3
        data[:, 1] = (abs(self.height - 0.52) + 0.1) * np.sin(2.0 * np.pi * 5.5 * times)
        message.data = array.array("d", data.ravel().tolist())
        self.block += 1
        if self.controller.run is not None and not self.controller.run.done:
            self.show(message)
        command = self.controller.answer(0.05 * self.block, STEADY, self.height).command
        self.height += float(np.clip(command.height - self.height, -0.015, 0.015))
        self.server.report()

    def show(self, message: SampleBlock) -> None:
        """Publish a block to the search and wait until it has been seen."""
        end = time.monotonic() + 100.0
        while not self.blocks.get_subscription_count():
            assert time.monotonic() < end, "the search does not subscribe"
            self.executor.spin_once(timeout_sec=0.02)
        self.blocks.publish(message)
        while self.seen < 0.05 * self.block - 1e-6:
            assert time.monotonic() < end, "the block was not seen"
            self.executor.spin_once(timeout_sec=0.02)
        self.executor.spin_once(timeout_sec=0.0)

    def search(self, **goal: float) -> tuple[Any, list[SearchHeight.Feedback]]:
        assert self.actions.wait_for_server(timeout_sec=100.0)
        told: list[SearchHeight.Feedback] = []
        sent = self.actions.send_goal_async(
            SearchHeight.Goal(**goal), feedback_callback=lambda message: told.append(message.feedback)
        )
        return self.wait(sent), told

    def close(self) -> None:
        self.server.close()
        self.actions.destroy()
        for node in (self.node, self.client):
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_a_search_ends_at_the_best_height_with_feedback_on_the_way(stand: Stand) -> None:
    goal, told = stand.search(**GOAL)
    assert goal.accepted
    answer = stand.wait(goal.get_result_async(), stand.turn)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.success
    assert answer.result.height == pytest.approx(0.5)
    assert [feedback.iteration for feedback in told][-1] == answer.result.iterations == 6


def test_a_search_may_begin_long_after_the_run(stand: Stand) -> None:
    for _ in range(200):
        stand.turn()
    goal, _ = stand.search(**GOAL)
    assert stand.wait(goal.get_result_async(), stand.turn).result.height == pytest.approx(0.5)


def test_a_search_can_be_cancelled_and_another_begun(stand: Stand) -> None:
    goal, told = stand.search(**GOAL)
    result = goal.get_result_async()
    while len(told) < 3:
        stand.turn()
    goal.cancel_goal_async()
    answer = stand.wait(result, stand.turn)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.message == "cancelled; the best of 2 heights was 0.2000 m"
    assert answer.result.height == pytest.approx(0.2)
    here = stand.height
    for _ in range(20):
        stand.turn()
    assert stand.height == pytest.approx(here, abs=1e-9)
    again, _ = stand.search(**GOAL)
    assert again.accepted


def test_a_search_is_cancelled_also_where_no_estimates_come(stand: Stand) -> None:
    goal, _ = stand.search(**GOAL)
    result = goal.get_result_async()
    goal.cancel_goal_async()
    answer = stand.wait(result)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.message == "cancelled"
    assert math.isnan(answer.result.height)


def test_a_silent_loop_ends_a_search_with_the_reason(stand: Stand) -> None:
    goal, _ = stand.search(**GOAL)
    result = goal.get_result_async()
    stand.turn()
    stand.server.stop("no messages on excitation")
    answer = stand.wait(result)
    assert (answer.status, answer.result.message) == (GoalStatus.STATUS_ABORTED, "no messages on excitation")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"highest": 2.0}, "limits: given 0.1 to 2 m; allowed is the ceiling's 0.017 to 1 m"),
        ({"step": -0.1}, "step: given -0.1 m; allowed is a number above 0"),
        ({"dwell": 0.5}, "dwell: given 0.5 s; allowed is at least 1 s"),
        ({"lowest": math.nan}, "limits: given nan to 0.9 m; allowed are two rising heights above 0"),
    ],
)
def test_a_goal_that_cannot_be_searched_is_aborted_with_the_reason(
    stand: Stand, change: dict[str, float], reason: str
) -> None:
    goal, _ = stand.search(**{**GOAL, **change})
    assert goal.accepted
    answer = stand.wait(goal.get_result_async())
    assert (answer.status, answer.result.success) == (GoalStatus.STATUS_ABORTED, False)
    assert answer.result.message == reason


def test_a_second_search_is_aborted_and_the_first_goes_on(stand: Stand) -> None:
    first, _ = stand.search(**GOAL)
    result = first.get_result_async()
    second, _ = stand.search(**GOAL)
    assert "is running" in stand.wait(second.get_result_async()).result.message
    assert stand.wait(result, stand.turn).status == GoalStatus.STATUS_SUCCEEDED
