# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identifier node over real DDS: the handshake, one estimate for each block with its last stamp, and refusals."""

import array
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from atpid_interfaces.msg import CeilingState, Event, Excitation, SampleBlock
from spun import Spun

from atpid_common.nodes.messages import BLOCKS, STATES, nanoseconds_of, time_of
from atpid_common.nodes.parameters import ParameterError
from atpid_control.identification import IdentificationError
from atpid_control.loop.drift import WatchError
from atpid_control.nodes.identifier_node import IdentifierNode, last_stamp
from atpid_control.stand.parameters import parameters_in
from atpid_sim.plant.stream import stamp_ns
from atpid_sim.scene import SceneError

ROOT = Path(__file__).parents[2]
CONFIG = yaml.safe_load((ROOT / "atpid_control/config/identifier.yaml").read_text(encoding="utf-8"))
RATE, START = 1000.0, 1_700_000_000_123_456_789


class Stand(Spun):
    """The node and a peer that plays the sensors."""

    def __init__(self) -> None:
        super().__init__("peer")
        peer = self.peer
        self.estimates: list[Excitation] = []
        self.events: list[Event] = []
        self.handshakes: list[Excitation] = []
        peer.create_subscription(Excitation, "excitation", self._hear, 100)
        peer.create_subscription(Event, "events", self.events.append, 100)
        self.blocks = peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.ceiling = peer.create_publisher(CeilingState, "ceiling/state", STATES)

    def identifier(self, **parameters: Any) -> IdentifierNode:
        given = parameters_in(CONFIG, "identifier_node") | parameters
        made: IdentifierNode = self.make(IdentifierNode, given)
        self.until(lambda: self.handshakes, lambda: self.blocks.publish(SampleBlock(handshake=True)))
        self.until(lambda: self.peer.count_publishers("events"))
        return made

    def _hear(self, message: Excitation) -> None:
        (self.handshakes if message.handshake else self.estimates).append(message)

    def ask(self, first: int, channels: dict[str, Any], rate: float = RATE, unit: str = "m") -> Excitation:
        """Return the one estimate that answers a block."""
        before = len(self.estimates)
        self.blocks.publish(sample_block(first, channels, rate, unit))
        self.until(lambda: len(self.estimates) > before)
        assert len(self.estimates) == before + 1
        return self.estimates[-1]


def sample_block(first: int, channels: dict[str, Any], rate: float = RATE, unit: str = "m") -> SampleBlock:
    block = SampleBlock(first_index=first, rate=rate, channels=list(channels), units=[unit] * len(channels))
    block.header.stamp, block.device = time_of(stamp_ns(START, first, rate)), "plant"
    block.skew = array.array("d", [0.0] * len(channels))
    block.data = array.array("d", np.stack(list(channels.values()), axis=1).astype(np.float64).ravel())
    return block


def sine(first: int, amplitude: float, rate: float = RATE, frequency: float = 5.49) -> Any:
    """Return a block of 50 samples of a tone."""
    return amplitude * np.sin(2 * np.pi * frequency * (first + np.arange(50)) / rate)


@pytest.fixture
def stand() -> Iterator[Stand]:
    stand = Stand()
    yield stand
    stand.close()


@pytest.fixture
def node(stand: Stand) -> IdentifierNode:
    return stand.identifier()


def test_each_block_has_one_estimate_with_the_stamp_of_its_last_sample(stand: Stand, node: IdentifierNode) -> None:
    (handshake,) = {(one.handshake, nanoseconds_of(one.header.stamp), one.quality) for one in stand.handshakes}
    assert handshake == (True, 0, Excitation.NONE)
    rate = 999.7
    for first in range(0, 1000, 50):
        support, beam = (sine(first, amplitude, rate) for amplitude in (0.015, 0.2))
        answer = stand.ask(first, {"support_displacement": support, "beam_displacement": beam}, rate)
        assert nanoseconds_of(answer.header.stamp) == stamp_ns(START, first + 49, rate)
        assert answer.last_index == first + 49
    assert (answer.quality, answer.origin) == (Excitation.STEADY, Excitation.SUPPORT)
    assert (answer.amplitude, answer.frequency) == pytest.approx((0.015, 5.49), rel=1e-6)
    assert answer.beam_amplitude == pytest.approx(0.2, rel=0.005)


def test_a_second_tone_is_an_event_and_its_estimates_are_poor(stand: Stand, node: IdentifierNode) -> None:
    qualities = []
    for first in range(0, 5000, 50):
        other = sine(first, 0.006 if first < 3500 else 0.0, frequency=7.1)
        qualities.append(stand.ask(first, {"support_displacement": sine(first, 0.015) + other}).quality)
    stand.until(lambda: any(event.kind == "excitation_changed" for event in stand.events))
    second = [event for event in stand.events if event.kind == "two_tones"]
    assert [event.severity for event in second] == [Event.WARNING, Event.INFO]
    assert second[0].value == pytest.approx(0.006, rel=0.02)
    assert re.findall(r"[\d.]+", second[0].text) == ["0.015", "5.49", "0.00599", "7.1"]
    assert set(qualities[60:70]) == {Excitation.POOR}
    assert qualities[-1] == Excitation.STEADY
    assert node.identifier.other is None
    changed = [event.value for event in stand.events if event.kind == "excitation_changed"]
    assert changed[-1] == pytest.approx(0.015, rel=0.01)


def test_a_block_without_the_channel_is_answered_and_logged_once(stand: Stand, node: IdentifierNode) -> None:
    for first in (0, 50):
        answer = stand.ask(first, {"temperature": np.zeros(50)})
        assert answer.quality == Excitation.NONE
        assert nanoseconds_of(answer.header.stamp) == stamp_ns(START, first + 49, RATE)
    assert {"support_displacement", "temperature"} <= set(re.findall(r"\w+", node.last_error))


def test_from_the_beam_alone_through_the_closed_damper(stand: Stand) -> None:
    stand.identifier(origin="beam", scene=str(ROOT / "scenes" / "closed_damper.yaml"))
    blocks = iter(range(0, 100_000, 50))

    def more() -> None:
        first = next(blocks)
        stand.ceiling.publish(CeilingState(height=0.017))
        stand.ask(first, {"beam_displacement": sine(first, 0.2)})

    stand.until(lambda: stand.estimates and stand.estimates[-1].quality == Excitation.STEADY, more)
    answer = stand.estimates[-1]
    assert answer.origin == Excitation.BEAM
    assert 0.005 < answer.amplitude < 0.02
    assert answer.amplitude_std > 0.01 * answer.amplitude


@pytest.mark.parametrize(
    ("parameters", "error", "line"),
    [
        ({"window_periods": 0.5}, ParameterError, "window_periods .*0.5; .*1 .*20"),
        ({"origin": "guess"}, ParameterError, "origin .*'guess'; .*'support', 'beam'"),
        ({"lowest_frequency": 50.0}, IdentificationError, "highest_frequency: .*40; .*lowest_frequency"),
        ({"rumble_calm": 0.5}, WatchError, "calm: .*0.5; .*onset"),
        ({"origin": "beam"}, IdentificationError, "scene: "),
        ({"origin": "beam", "scene": "missing.yaml"}, SceneError, "missing.yaml"),
    ],
)
def test_bad_parameters_are_refused_in_one_line(
    stand: Stand, parameters: dict[str, Any], error: type[ValueError], line: str
) -> None:
    with pytest.raises(error, match=line) as refused:
        stand.identifier(**parameters)
    assert "\n" not in str(refused.value)


def test_the_last_stamp_is_rounded_as_the_source_rounds_it() -> None:
    for rate in (1000.0, 3000.0, 999.7, 44_100.0):
        for first in (0, 50, 12_345_678):
            block = sample_block(first, {"support_displacement": np.zeros(37)}, rate)
            assert last_stamp(block) == stamp_ns(START, first + 36, rate)


def test_rumble_is_an_event_with_the_stamp_of_an_estimate(stand: Stand, node: IdentifierNode) -> None:
    jumps = 0.1 * (1.0 + 0.5 * (np.arange(40) > 15) * np.random.default_rng(1).random(40))
    sizes = np.interp(np.arange(6000) / RATE, np.arange(40) / 5.49, jumps)
    for first in range(0, 6000, 50):
        beam = sizes[first : first + 50] * sine(first, 1.0)
        stand.ask(first, {"support_displacement": sine(first, 0.015), "beam_displacement": beam})
        if any(event.kind == "rumble" for event in stand.events):
            break
    rumble = next(event for event in stand.events if event.kind == "rumble")
    assert rumble.severity == Event.WARNING
    assert rumble.value >= 0.06
    assert rumble.header.stamp in [estimate.header.stamp for estimate in stand.estimates[-2:]]


def test_an_acceleration_gives_the_displacements_estimate(stand: Stand, node: IdentifierNode) -> None:
    omega = 2 * np.pi * 5.49
    for first in range(0, 1000, 50):
        answer = stand.ask(first, {"support_displacement": -(omega**2) * sine(first, 0.015)}, unit="m/s^2")
    assert answer.quality == Excitation.STEADY
    assert answer.amplitude == pytest.approx(0.015, rel=1e-6)
    stand.until(lambda: stand.events)
    assert re.findall(r"[\d.]+ \w+", stand.events[0].text) == ["0.01500 m", "5.490 Hz"]
