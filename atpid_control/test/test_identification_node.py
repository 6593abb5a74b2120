# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identifier node over real DDS: the handshake, one estimate for each block with its last stamp, and refusals."""

import array
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from atpid_interfaces.msg import CeilingState, Event, Excitation, SampleBlock
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.messages import BLOCKS, STATES, nanoseconds_of, time_of
from atpid_common.nodes.parameters import ParameterError
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.identification import IdentificationError
from atpid_control.loop.drift import WatchError
from atpid_control.nodes.identifier_node import IdentifierNode, last_stamp
from atpid_sim.plant.stream import stamp_ns
from atpid_sim.scene import SceneError

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "atpid_control" / "config" / "identifier.yaml"
RATE, START = 1000.0, 1_700_000_000_123_456_789


def configured() -> dict[str, Any]:
    document = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    found: dict[str, Any] = document["/**/identifier_node"]["ros__parameters"]
    return found


class Stand:
    """The node and a peer that plays the sensors, on one executor."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.peer = Node("peer", context=self.context)
        self.executor.add_node(self.peer)
        self.estimates: list[Excitation] = []
        self.events: list[Event] = []
        self.handshakes: list[Excitation] = []
        self.peer.create_subscription(Excitation, "excitation", self._hear, 100)
        self.peer.create_subscription(Event, "events", self.events.append, 100)
        self.blocks = self.peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.ceiling = self.peer.create_publisher(CeilingState, "ceiling/state", STATES)

    def identifier(self, **parameters: Any) -> IdentifierNode:
        values = [Parameter(name, value=value) for name, value in (configured() | parameters).items()]
        node = IdentifierNode(parameter_overrides=values, context=self.context)
        self.executor.add_node(node)
        return node

    def until(self, condition: Callable[[], object], act: Callable[[], None] = lambda: None) -> None:
        end = time.monotonic() + 100.0
        while not condition():
            assert time.monotonic() < end, "the event waited for did not come"
            act()
            self.executor.spin_once(timeout_sec=0.02)

    def shake_hands(self) -> Excitation:
        handshake = SampleBlock()
        handshake.handshake = True
        self.until(lambda: self.handshakes, lambda: self.blocks.publish(handshake))
        self.until(lambda: self.peer.count_publishers("events"))
        return self.handshakes[0]

    def _hear(self, message: Excitation) -> None:
        (self.handshakes if message.handshake else self.estimates).append(message)

    def ask(self, block: SampleBlock) -> Excitation:
        before = len(self.estimates)
        self.blocks.publish(block)
        self.until(lambda: len(self.estimates) > before)
        assert len(self.estimates) == before + 1
        return self.estimates[-1]

    def close(self) -> None:
        for node in list(self.executor.get_nodes()):
            if isinstance(node, IdentifierNode):
                node.close()
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


def sample_block(first: int, channels: dict[str, Any], rate: float = RATE, skew: float = 0.0) -> SampleBlock:
    block = SampleBlock(first_index=first, rate=rate, channels=list(channels), units=["m"] * len(channels))
    block.header.stamp, block.device = time_of(stamp_ns(START, first, rate)), "plant"
    block.skew = array.array("d", [skew] * len(channels))
    data = np.stack([np.asarray(values) for values in channels.values()], axis=1)
    block.data = array.array("d", data.astype(np.float64).ravel())
    return block


def sine(first: int, scans: int, amplitude: float, rate: float = RATE) -> Any:
    return amplitude * np.sin(2 * np.pi * 5.49 * (first + np.arange(scans)) / rate)


@pytest.fixture
def stand() -> Iterator[Stand]:
    stand = Stand()
    yield stand
    stand.close()


def test_a_handshake_is_answered_in_kind(stand: Stand) -> None:
    stand.identifier()
    answer = stand.shake_hands()
    assert answer.handshake
    assert nanoseconds_of(answer.header.stamp) == 0
    assert answer.quality == Excitation.NONE


def test_each_block_has_one_estimate_with_the_stamp_of_its_last_sample(stand: Stand) -> None:
    stand.identifier()
    stand.shake_hands()
    rate = 999.7
    for first in range(0, 1000, 50):
        channels = {
            "support_displacement": sine(first, 50, 0.015, rate),
            "beam_displacement": sine(first, 50, 0.2, rate),
        }
        answer = stand.ask(sample_block(first, channels, rate))
        assert nanoseconds_of(answer.header.stamp) == stamp_ns(START, first + 49, rate)
        assert answer.last_index == first + 49
    assert answer.quality == Excitation.STEADY
    assert answer.origin == Excitation.SUPPORT
    assert answer.amplitude == pytest.approx(0.015, rel=1e-6)
    assert answer.frequency == pytest.approx(5.49, rel=1e-6)
    assert answer.beam_amplitude == pytest.approx(0.2, rel=0.005)


def test_a_change_is_an_event_once_it_is_steady_again(stand: Stand) -> None:
    stand.identifier()
    stand.shake_hands()
    for first in range(0, 2000, 50):
        amplitude = 0.015 if first < 1000 else 0.03
        stand.ask(sample_block(first, {"support_displacement": sine(first, 50, amplitude)}))
    stand.until(lambda: len(stand.events) == 2)
    assert [event.kind for event in stand.events] == ["excitation_changed"] * 2
    assert stand.events[1].value == pytest.approx(0.03, rel=0.01)


def test_a_second_tone_is_an_event_and_its_estimates_are_poor(stand: Stand) -> None:
    node = stand.identifier()
    stand.shake_hands()
    qualities = []
    for first in range(0, 5000, 50):
        support = sine(first, 50, 0.015)
        if first < 3500:
            support = support + 0.006 * np.sin(2 * np.pi * 7.1 * (first + np.arange(50)) / RATE)
        qualities.append(stand.ask(sample_block(first, {"support_displacement": support})).quality)
    stand.until(lambda: any(event.kind == "excitation_changed" for event in stand.events))
    second = [event for event in stand.events if event.kind == "two_tones"]
    assert [event.severity for event in second] == [Event.WARNING, Event.INFO]
    assert second[0].value == pytest.approx(0.006, rel=0.02)
    assert "two tones excite the structure, 0.015 m at 5.49 Hz and 0.00599 m at 7.1 Hz" in second[0].text
    assert set(qualities[60:70]) == {Excitation.POOR}
    assert qualities[-1] == Excitation.STEADY
    assert node.identifier.other is None


def test_a_block_without_the_channel_is_answered_and_logged_once(stand: Stand) -> None:
    node = stand.identifier()
    stand.shake_hands()
    for first in (0, 50):
        answer = stand.ask(sample_block(first, {"temperature": np.zeros(50)}))
        assert answer.quality == Excitation.NONE
        assert nanoseconds_of(answer.header.stamp) == stamp_ns(START, first + 49, RATE)
    assert "support_displacement" in node.last_error
    assert "temperature" in node.last_error


def test_from_the_beam_alone_through_the_closed_damper(stand: Stand) -> None:
    stand.identifier(origin="beam", scene=str(ROOT / "scenes" / "closed_damper.yaml"))
    stand.shake_hands()
    state = CeilingState(height=0.017)
    first = 0

    def more() -> None:
        nonlocal first
        stand.ceiling.publish(state)
        stand.ask(sample_block(first, {"beam_displacement": sine(first, 50, 0.2)}))
        first += 50

    stand.until(lambda: stand.estimates and stand.estimates[-1].quality == Excitation.STEADY, more)
    answer = stand.estimates[-1]
    assert answer.origin == Excitation.BEAM
    assert 0.005 < answer.amplitude < 0.02
    assert answer.amplitude_std > 0.01 * answer.amplitude


@pytest.mark.parametrize(
    ("parameters", "error", "text"),
    [
        ({"window_periods": 0.5}, ParameterError, "window_periods of identifier_node: given 0.5; allowed: 1 to 20"),
        ({"origin": "guess"}, ParameterError, "origin of identifier_node: given 'guess'; allowed: 'support', 'beam'"),
        ({"lowest_frequency": 50.0}, IdentificationError, "highest_frequency: given 40; allowed: above lowest_freq"),
        ({"rumble_calm": 0.5}, WatchError, "calm: given 0.5; allowed: above 0 and at most onset"),
        ({"origin": "beam"}, IdentificationError, "scene: given none"),
        ({"origin": "beam", "scene": "missing.yaml"}, SceneError, "missing.yaml"),
    ],
)
def test_bad_parameters_are_refused_in_one_line(
    stand: Stand, parameters: dict[str, Any], error: type[ValueError], text: str
) -> None:
    with pytest.raises(error) as refused:
        stand.identifier(**parameters)
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_last_stamp_is_rounded_as_the_source_rounds_it() -> None:
    for rate in (1000.0, 3000.0, 999.7, 44_100.0):
        for first in (0, 50, 12_345_678):
            block = sample_block(first, {"support_displacement": np.zeros(37)}, rate)
            assert last_stamp(block) == stamp_ns(START, first + 36, rate)


def test_rumble_is_an_event_with_the_stamp_of_an_estimate(stand: Stand) -> None:
    stand.identifier()
    stand.shake_hands()
    rng = np.random.default_rng(1)
    jumpy = np.interp(
        np.arange(6000) / RATE, np.arange(40) / 5.49, 0.1 * (1.0 + 0.5 * (np.arange(40) > 15) * rng.random(40))
    )
    for first in range(0, 6000, 50):
        beam = jumpy[first : first + 50] * sine(first, 50, 1.0)
        stand.ask(sample_block(first, {"support_displacement": sine(first, 50, 0.015), "beam_displacement": beam}))
        if any(event.kind == "rumble" for event in stand.events):
            break
    rumble = next(event for event in stand.events if event.kind == "rumble")
    assert rumble.severity == Event.WARNING
    assert rumble.value >= 0.06
    assert rumble.header.stamp in [estimate.header.stamp for estimate in stand.estimates[-2:]]


def test_an_acceleration_gives_the_displacements_estimate_or_a_line(stand: Stand) -> None:
    node = stand.identifier()
    stand.shake_hands()
    random, omega, lines = np.random.default_rng(1), 2 * np.pi * 5.49, list[str]()
    for first in range(0, 1000, 50):
        block = sample_block(first, {"support_displacement": -(omega**2) * sine(first, 50, 0.015)})
        block.units = ["m/s^2"]
        answer = stand.ask(block)
    assert answer.quality == Excitation.STEADY
    assert answer.amplitude == pytest.approx(0.015, rel=1e-6)
    stand.until(lambda: stand.events)
    assert stand.events[0].text == "excitation is now 0.01500 m at 5.490 Hz"
    for first in range(1000, 2000, 50):
        block = sample_block(first, {"support_displacement": sine(first, 50, 0.1) + random.normal(0.0, 0.15, 50)})
        block.units = ["m/s^2"]
        answer = stand.ask(block)
        if node.last_error:
            lines.append(node.last_error)
            assert answer.quality == Excitation.NONE
    assert lines
    assert all(line.startswith("acceleration: given a tone at") for line in lines)
