# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is logged while the nodes start reaches the operator, also where a busy machine delivers it late; and Ctrl-C."""

import os
import signal
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import Excitation
from rcl_interfaces.msg import Log
from rclpy.node import Node

from atpid_common.nodes.messages import STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.stand.nodes.composition import ROSOUT, BenchWatch, _uninterrupted


@pytest.fixture
def reported() -> Iterator[tuple[list[str], BenchWatch, Node, TurnExecutor]]:
    rclpy.init()
    lines: list[str] = []
    watch, peer, executor = BenchWatch(lines.append), Node("peer", enable_rosout=False), TurnExecutor()
    executor.add_node(watch)
    yield lines, watch, peer, executor
    for node in (watch, peer):
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def log(text: str, moment: float) -> Log:
    """Return a warning logged at a moment of the wall clock [s]."""
    message = Log(level=Log.WARN, name="replay_node", msg=text)
    message.stamp.sec, message.stamp.nanosec = int(moment), int(moment % 1.0 * 1e9)
    return message


def test_a_warning_of_before_the_first_estimate_is_reported_once_and_later_ones_are_not(
    reported: tuple[list[str], BenchWatch, Node, TurnExecutor],
) -> None:
    lines, watch, peer, executor = reported
    logs = peer.create_publisher(Log, "/rosout", ROSOUT)
    estimates = peer.create_publisher(Excitation, "excitation", STATES)
    begin = time.time()
    answered: list[str] = []
    watch.create_subscription(Log, "/rosout", lambda message: answered.append(message.msg), ROSOUT)

    def until_answered(text: str) -> None:
        deadline = time.monotonic() + 60.0
        while text not in answered:
            assert time.monotonic() < deadline, f"{text} does not come"
            executor.spin_once(timeout_sec=0.1)

    estimate = Excitation()
    estimate.header.stamp.sec = 5
    deadline = time.monotonic() + 60.0
    while watch.elapsed == 0.0:  # of the second estimate
        assert time.monotonic() < deadline, "no estimate comes"
        estimate.header.stamp.sec += 1
        estimates.publish(estimate)
        executor.spin_once(timeout_sec=0.1)
    logs.publish(log("of the start", begin))
    logs.publish(log("of the start", begin))
    logs.publish(log("of the run", time.time()))
    logs.publish(log("the last", begin))
    until_answered("the last")
    assert lines == ["replay_node: of the start", "replay_node: the last"]


def test_a_signal_that_comes_after_a_turn_has_looked_for_one_is_not_lost() -> None:
    """Turns follow each other hundreds of times a second, so that a signal comes there once in a hundred times."""
    executor: Any = SimpleNamespace(spin_once=lambda timeout_sec: None)

    def turned() -> None:
        with _uninterrupted(executor) as turn:
            turn(0.0)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        turned()
