# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selector node: its service, and one command for each estimate."""

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingCommand, Event, Excitation
from atpid_interfaces.srv import SelectHeight
from graph_runs import parameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.messages import EVENTS, STATES, nanoseconds_of, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.selector_node import SelectorNode
from atpid_sim.scene import Scene


class Peer(Node):
    """Publishes estimates, receives commands and events, calls the service."""

    def __init__(self) -> None:
        super().__init__("peer")
        self.commands: list[CeilingCommand] = []
        self.events: list[Event] = []
        self.excitation = self.create_publisher(Excitation, "excitation", STATES)
        self.create_subscription(CeilingCommand, "ceiling/command", self.commands.append, STATES)
        self.create_subscription(Event, "events", self.events.append, EVENTS)
        self.select = self.create_client(SelectHeight, "selector_node/select")


Spin = Callable[[Callable[[], object]], None]
Pair = tuple[Peer, Spin, Scene]


@pytest.fixture
def pair(scenes: Path, tmp_path: Path) -> Iterator[Pair]:
    """A selector in lockstep beside a peer, both discovered."""
    rclpy.init()
    scene, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=True)
    overrides = [Parameter(name, value=value) for name, value in given["selector_node"].items()]
    selector, peer, executor = SelectorNode(parameter_overrides=overrides), Peer(), TurnExecutor()
    executor.add_node(selector)
    executor.add_node(peer)

    def spin(until: Callable[[], object]) -> None:
        deadline = time.monotonic() + 100.0
        while not until():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.1)

    handshake = Excitation(handshake=True)

    def greet() -> bool:
        peer.excitation.publish(handshake)
        executor.spin_once(timeout_sec=0.1)
        return bool(peer.commands) and peer.select.service_is_ready()

    spin(greet)
    yield peer, spin, scene
    for node in (selector, peer):
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def ask(peer: Peer, spin: Spin, **request: Any) -> Any:
    answer = peer.select.call_async(SelectHeight.Request(**request))
    spin(answer.done)
    return answer.result()


def estimates(
    peer: Peer, spin: Spin, scene: Scene, amplitude: float, count: int, frequency: float | None = None
) -> list[CeilingCommand]:
    """Send steady estimates; return the commands that answer them."""

    def answers() -> list[CeilingCommand]:
        return [command for command in peer.commands if not command.handshake]

    def answered(count: int) -> Callable[[], object]:
        return lambda: len(answers()) == count

    before = len(answers())
    for number in range(before, before + count):
        message = Excitation(quality=Excitation.STEADY, amplitude=amplitude, amplitude_std=1e-6)
        message.frequency = scene.frequency_hz if frequency is None else frequency
        message.header.stamp = time_of(49_000_000 + 50_000_000 * number)
        peer.excitation.publish(message)
        spin(answered(number + 1))
    return answers()[before:]


def test_a_handshake_is_answered_with_no_height(pair: Pair) -> None:
    peer, _, _ = pair
    assert peer.commands[0].handshake
    assert math.isnan(peer.commands[0].height)


def test_each_estimate_gets_one_command_with_its_stamp(pair: Pair) -> None:
    peer, spin, scene = pair
    commands = estimates(peer, spin, scene, 0.015, 6)
    assert [nanoseconds_of(c.header.stamp) for c in commands] == [49_000_000 + 50_000_000 * k for k in range(6)]
    assert [c.sequence for c in commands] == [0, 0, 0, 1, 1, 1]
    assert commands[-1].height == pytest.approx(0.29, rel=0.05)
    assert commands[-1].method == "lookup"


def test_off_resonance_is_refused_once_and_the_height_stays(pair: Pair) -> None:
    peer, spin, scene = pair
    height = estimates(peer, spin, scene, 0.015, 4)[-1].height
    later = estimates(peer, spin, scene, 0.03, 10, frequency=6.5)
    assert {command.height for command in later} == {height}
    spin(lambda: any(event.kind == "refused" for event in peer.events))
    refused = [event for event in peer.events if event.kind == "refused"]
    assert [(event.severity, event.value) for event in refused] == [(Event.WARNING, 6.5)]


def test_the_service_answers_for_the_amplitude_given(pair: Pair) -> None:
    peer, spin, _ = pair
    answer = ask(peer, spin, amplitude=0.03, frequency=5.47)
    assert answer.success
    assert answer.method == "lookup"
    assert answer.height == pytest.approx(0.57, rel=0.05)
    assert answer.efficiency > 0.76


def test_a_service_called_before_any_estimate_gives_the_reason(pair: Pair) -> None:
    peer, spin, scene = pair
    answer = ask(peer, spin, amplitude=0.0)
    assert not answer.success
    assert "no steady estimate yet" in answer.message
    assert math.isnan(answer.height)
    estimates(peer, spin, scene, 0.015, 1)
    assert ask(peer, spin, amplitude=0.0).height == pytest.approx(0.29, rel=0.05)
    assert "amplitude: given nan; allowed: " in ask(peer, spin, amplitude=math.nan).message


def test_a_request_outside_the_map_gives_the_reason(pair: Pair) -> None:
    peer, spin, _ = pair
    answer = ask(peer, spin, amplitude=5.0)
    assert not answer.success
    assert "amplitude 5 m is outside" in answer.message
