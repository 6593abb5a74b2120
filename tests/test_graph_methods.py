# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes whose controller computes its heights run on the bench like the others; a slow one says so in real time."""

import time
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingCommand, Event, Excitation
from graph_runs import in_lockstep, parameters, scene_file
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.messages import EVENTS, STATES, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.selector_node import SelectorNode
from atpid_control.runs.run import open_run
from atpid_control.stand.summary import unanswered_blocks
from atpid_sim.scene import load_scene

CEILING = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["pca", "direct", "search"])
def test_a_method_that_computes_runs_on_the_bench(scenes: Path, tmp_path: Path, method: str) -> None:
    changes = {"duration": 4.0, "steady_window": [3.0, 4.0], "ceiling": CEILING | {"controller": method}}
    bag = in_lockstep(scene_file(scenes / "stepped_4_8.yaml", tmp_path, **changes), tmp_path / "run")
    commands = [message for _, message in bag.messages("/ceiling/command")]
    assert {message.method for message in commands} == {method}
    # `direct` keeps its margin for an error of mass, frequency and restitution, too
    assert commands[-1].height == pytest.approx(0.57, rel=0.1 if method == "direct" else 0.05)
    assert unanswered_blocks(open_run(bag.path)) == 0
    assert not [event for _, event in bag.messages("/events") if event.severity == Event.ALARM]


class Slow:
    """Takes longer than a block."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def answer(self, *arguments: Any) -> Any:
        end = time.monotonic() + 0.06
        while time.monotonic() < end:
            pass
        return self.inner.answer(*arguments)


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_controller_that_takes_long_is_reported_in_real_time(scenes: Path, tmp_path: Path, lockstep: bool) -> None:
    rclpy.init()
    try:
        path = scenes / "stepped_4_8.yaml"
        _, given = parameters(path, tmp_path, lockstep=lockstep)
        overrides = [Parameter(name, value=value) for name, value in given["selector_node"].items()]
        selector, peer, executor = SelectorNode(parameter_overrides=overrides), Node("peer"), TurnExecutor()
        slow: Any = Slow(selector._controller)
        selector._controller = slow
        commands: list[CeilingCommand] = []
        events: list[Event] = []
        peer.create_subscription(CeilingCommand, "ceiling/command", commands.append, STATES)
        peer.create_subscription(Event, "events", events.append, EVENTS)
        excitation = peer.create_publisher(Excitation, "excitation", STATES)
        executor.add_node(selector)
        executor.add_node(peer)
        message = Excitation(quality=Excitation.STEADY, amplitude=0.02, amplitude_std=1e-6)
        message.frequency, message.header.stamp = load_scene(path).frequency_hz, time_of(49_000_000)
        deadline = time.monotonic() + 100.0
        while not commands or not (events or lockstep):
            assert time.monotonic() < deadline
            excitation.publish(message)
            executor.spin_once(timeout_sec=0.1)
        for _ in range(20):
            executor.spin_once(timeout_sec=0.0)
        assert {event.kind for event in events} == (set() if lockstep else {"slow"})
        selector.close()
        for node in (selector, peer):
            node.destroy_node()
        executor.shutdown()
    finally:
        rclpy.try_shutdown()
