# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant node at its ends: a plant that fails, a machine too slow, and a recorder that is waited for."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graph_runs import scene_file
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from atpid_common.nodes import recorder_watch
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, STATUS, nanoseconds_of, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_sim.nodes.plant_node import PlantNode
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene

ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FIELDS = ("excitation_amplitude", "excitation_frequency", "input_energy", "beam_loss", "contact_loss",
          "ceiling_work", "stored_energy")  # fmt: skip


class Oscillator:
    """A stand-in for the plant in closed form: no grain, one tone."""

    def __init__(self, scene: Scene, fails_at: float = np.inf, seconds_a_block: float = 0.0) -> None:
        self.height, self.ticks = 0.017, 0
        self.fails_at, self.delay = fails_at, seconds_a_block
        self.commanded: list[tuple[float, float]] = []  # height [m], speed [m/s]

    def advance(self, duration_ticks: int, rate: int, target: float, speed: float) -> SimpleNamespace:
        until = time.monotonic() + self.delay
        t = (self.ticks + np.arange(duration_ticks)) / rate
        self.ticks += duration_ticks
        self.commanded.append((target, speed))
        if self.ticks / rate > self.fails_at:
            raise NumericalFailure(Outcome.ESCAPED.sentence)
        while time.monotonic() < until:
            continue
        wave = np.sin(2.0 * np.pi * 5.47 * t)
        series = {name: wave for name in ("support", "beam", "beam_acceleration", "grain", "ceiling")}
        return SimpleNamespace(**series, **dict.fromkeys(FIELDS, 0.0), impacts=0, outcome=Outcome.DONE)


class Peer(Node):
    """Identifier, selector and motor in one: answers each block with a state."""

    def __init__(self) -> None:
        super().__init__("peer")
        self.blocks: list[SampleBlock] = []
        self.events: list[Event] = []
        self.handshakes = 0
        self.states = self.create_publisher(CeilingState, "ceiling/state", STATES)
        self.status = self.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self.blocks_in = self.create_subscription(SampleBlock, "sensors/laser", self.on_block, BLOCKS)
        self.create_subscription(Event, "events", self.on_event, EVENTS)

    def on_block(self, block: SampleBlock) -> None:
        state = CeilingState(handshake=block.handshake, mode=CeilingState.MOVING, height=0.1, target=0.3, speed=0.25)
        state.header.frame_id = block.header.frame_id
        if block.handshake:
            self.handshakes += 1
        else:
            self.blocks.append(block)
            last = (len(block.data) // 2 - 1) / block.rate
            state.header.stamp = time_of(nanoseconds_of(block.header.stamp) + round(1e9 * last))
        self.states.publish(state)

    def on_event(self, event: Event) -> None:
        if not event.handshake:
            self.events.append(event)


Spin = Callable[[Callable[[], object]], None]
Start = Callable[..., tuple[PlantNode, Peer, Spin]]


@pytest.fixture
def graph(scenes: Path, tmp_path: Path) -> Iterator[Start]:
    """Make a plant node beside a peer; spin both until a condition holds."""
    rclpy.init()
    made: list[Node] = []
    executor = TurnExecutor()

    def start(
        make_plant: Callable[[Scene], Any],
        *,
        lockstep: bool = True,
        expect_recorder: bool = False,
        duration: float = 0.5,
    ) -> tuple[PlantNode, Peer, Spin]:
        changes = {"duration": duration, "steady_window": [0.1, duration], "ceiling": {
            "closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}}  # fmt: skip
        path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
        given = {"scene": str(path), "lockstep": lockstep, "expect_recorder": expect_recorder}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        plant, peer = PlantNode(parameter_overrides=overrides, make_plant=make_plant), Peer()
        made.extend([plant, peer])
        for node in made:
            executor.add_node(node)

        def spin(until: Callable[[], object]) -> None:
            deadline = time.monotonic() + 100.0
            while not until():
                assert time.monotonic() < deadline
                executor.spin_once(timeout_sec=0.1)

        return plant, peer, spin

    yield start
    for node in made:
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def test_each_block_waits_for_its_answer_and_the_ceiling_follows_the_state(graph: Start) -> None:
    plants: list[Oscillator] = []

    def make(scene: Scene) -> Oscillator:
        plants.append(Oscillator(scene))
        return plants[-1]

    plant, peer, spin = graph(make)
    spin(plant.done.done)
    spin(lambda: len(peer.events) == 2)
    assert plant.done.result() == 0
    assert [block.first_index for block in peer.blocks] == list(range(0, 500, 50))
    assert (peer.blocks[1].device, peer.blocks[1].header.frame_id) == ("plant:laser", "stand")
    assert plants[-1].commanded == [(0.017, 0.0)] + [(0.3, 0.25)] * 9
    assert [(event.kind, event.severity) for event in peer.events] == [
        (Event.STARTED, Event.INFO),
        (Event.FINISHED, Event.INFO),
    ]
    assert (peer.events[0].value, peer.events[0].text) == (0.5, "scene.yaml: 0.5 s in lockstep")
    assert nanoseconds_of(peer.events[0].header.stamp) == 0


def test_a_plant_that_fails_alarms_and_ends_with_status_3(graph: Start) -> None:
    plant, peer, spin = graph(lambda scene: Oscillator(scene, fails_at=0.2))
    spin(plant.done.done)
    spin(lambda: len(peer.events) == 3)
    assert plant.done.result() == 3
    assert [(event.kind, event.severity) for event in peer.events[1:]] == [
        (Event.FAILED, Event.ALARM),
        (Event.FINISHED, Event.ALARM),
    ]
    assert plant.failure == f"the plant stopped at 0.2 s: {Outcome.ESCAPED.sentence}"
    assert peer.events[1].text == plant.failure


@pytest.mark.slow
def test_in_real_time_the_plant_wakes_once_for_each_block(graph: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    wakes: list[int] = []
    pace = PlantNode._pace

    def counted(node: PlantNode) -> None:
        wakes.append(node.stream.computed_ticks)
        pace(node)

    monkeypatch.setattr(PlantNode, "_pace", counted)
    plant, _, spin = graph(Oscillator, lockstep=False)
    spin(plant.done.done)
    assert plant.done.result() == 0
    assert len(wakes) <= 2 * plant.stream.blocks  # a timer may be a moment early; polling woke five times a block


@pytest.mark.slow
def test_a_machine_too_slow_for_real_time_is_reported_once_and_nothing_is_left_out(graph: Start) -> None:
    plant, peer, spin = graph(lambda scene: Oscillator(scene, seconds_a_block=0.07), lockstep=False)
    spin(plant.done.done)
    spin(lambda: len(peer.blocks) == 10 and len(peer.events) == 3)
    assert [event.kind for event in peer.events] == [Event.STARTED, Event.BEHIND, Event.FINISHED]
    assert peer.events[1].value > 0.05
    assert [block.first_index for block in peer.blocks] == list(range(0, 500, 50))


@pytest.mark.slow
def test_in_real_time_stamps_are_the_start_plus_index_over_rate(graph: Start) -> None:
    begun = time.time_ns()
    plant, peer, spin = graph(Oscillator, lockstep=False)
    spin(plant.done.done)
    spin(lambda: len(peer.blocks) == 10)
    stamps = [nanoseconds_of(block.header.stamp) for block in peer.blocks]
    assert stamps[0] >= begun
    assert np.diff(stamps).tolist() == [50_000_000] * 9
    assert time.time_ns() - stamps[0] >= 500_000_000


TOPICS = ["/sensors/laser", "/plant/truth", "/events", "/excitation", "/ceiling/command", "/ceiling/state"]


def recorder_status(*, recording: bool, received: int) -> RecorderStatus:
    counts = [received] * len(TOPICS)
    return RecorderStatus(recording=recording, bag="/bags/run", topics=TOPICS, received=counts, written=counts)


def test_nothing_starts_before_the_recorder_hears_everything_and_the_end_waits_for_its_bag(graph: Start) -> None:
    plant, peer, spin = graph(Oscillator, expect_recorder=True)
    spin(lambda: peer.handshakes > 3)
    assert not peer.blocks
    assert "recorder" in plant.waiting_for()
    status = recorder_status(recording=True, received=1)
    peer.status.publish(status)
    spin(lambda: bool(peer.events) and peer.events[-1].kind == Event.FINISHED)
    assert not plant.done.done()
    status.recording = False
    peer.status.publish(status)
    spin(plant.done.done)
    assert plant.done.result() == 0


@pytest.mark.slow
def test_a_recorder_that_goes_silent_is_reported_and_not_waited_for(
    graph: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_watch, "GONE_AFTER", 0.3)
    plant, peer, spin = graph(Oscillator, lockstep=False, expect_recorder=True, duration=2.0)
    spin(lambda: peer.handshakes > 3)
    peer.status.publish(recorder_status(recording=True, received=1))
    spin(lambda: any(event.kind == Event.STALE for event in peer.events))
    stale = next(event for event in peer.events if event.kind == Event.STALE)
    assert stale.severity == Event.WARNING
    assert stale.value > 0.3
    assert "/bags/run" in stale.text
    peer.status.publish(RecorderStatus(recording=True, bag="/bags/run"))
    spin(lambda: any(event.kind == Event.RESUMED for event in peer.events))
    spin(plant.done.done)  # although the recorder has not reported its bag closed
    assert plant.done.result() == 0


def test_a_recorder_whose_bag_is_closed_does_not_start_a_run(graph: Start) -> None:
    plant, peer, spin = graph(Oscillator, expect_recorder=True)
    spin(lambda: peer.handshakes > 3)
    peer.status.publish(recorder_status(recording=False, received=9))
    spin(lambda: "/bags/run is closed" in plant.waiting_for())
    assert not peer.blocks


@pytest.mark.slow
def test_what_is_waited_for_is_logged_with_the_nodes_that_are_missing(graph: Start) -> None:
    _, peer, spin = graph(Oscillator)
    peer.destroy_subscription(peer.blocks_in)
    logs: list[Log] = []
    peer.create_subscription(Log, "/rosout", logs.append, ROSOUT)
    spin(lambda: any("no samples yet" in log.msg for log in logs))
    (text,) = {log.msg for log in logs if "no samples yet" in log.msg}
    missing = "not running: identifier_node, selector_node, motor_node"
    assert text == f"no samples yet: waiting for an answer on ceiling/state; {missing}"


@pytest.mark.slow
def test_a_plant_reports_itself_on_the_absolute_diagnostics(graph: Start) -> None:
    _, peer, spin = graph(Oscillator, expect_recorder=True)
    found: list[DiagnosticArray] = []
    peer.create_subscription(DiagnosticArray, "/diagnostics", found.append, 10)
    spin(lambda: found)
    (status,) = found[-1].status
    assert (status.name, status.hardware_id) == ("plant_node: simulated plant", "simulated plant")
    assert status.message.startswith("waiting for ")
    assert status.level == DiagnosticStatus.OK
    assert {value.key: value.value for value in status.values}["scene"] == "scene.yaml"


def test_faults_are_injected_into_a_running_plant_by_its_parameter(graph: Start) -> None:
    plant, peer, spin = graph(Oscillator, lockstep=False, duration=20.0)
    spin(lambda: len(peer.blocks) > 2)

    def given(*faults: str) -> Any:
        return plant.set_parameters([Parameter("faults", value=list(faults))])[0]

    refused = given("motor off 0 9")
    assert not refused.successful
    assert refused.reason == (
        "faults: given motor; allowed: support_laser, beam_laser, accelerometer, clock, which the plant injects"
    )
    assert "which the plant injects" in given("recorder off 0 9").reason
    assert "the scene has none" in given("accelerometer off 0 9").reason
    assert given("support_laser off 0 1000").successful
    before = len(peer.blocks)
    spin(lambda: len(peer.blocks) > before + 2)
    assert np.isnan(np.array(peer.blocks[-1].data).reshape(-1, 2)).all(axis=0).tolist() == [True, False]
    assert given("").successful
    before = len(peer.blocks)
    spin(lambda: len(peer.blocks) > before + 2)
    assert np.isfinite(peer.blocks[-1].data).all()
    change = next(event for event in peer.events if event.kind == Event.PARAMETER)
    assert change.text == "parameter faults: [''] -> ['support_laser off 0 1000']"


def test_the_ceiling_is_where_it_is_and_not_where_a_motor_that_fails_reports_it(graph: Start) -> None:
    plants: list[Oscillator] = []

    def make(scene: Scene) -> Oscillator:
        plants.append(Oscillator(scene))
        return plants[-1]

    _plant, peer, spin = graph(make, lockstep=False, duration=20.0)
    truth = peer.create_publisher(CeilingState, "ceiling/truth", STATES)
    spin(lambda: plants and (0.3, 0.25) in plants[-1].commanded)
    spin(lambda: truth.get_subscription_count() == 1)
    truth.publish(CeilingState(mode=CeilingState.MOVING, height=0.4, target=0.4, speed=0.25))
    spin(lambda: plants[-1].commanded[-1] == (0.4, 0.25))
    reached, before = len(plants[-1].commanded), len(peer.blocks)
    spin(lambda: len(peer.blocks) > before + 2)  # which the peer has answered with ceiling/state
    assert set(plants[-1].commanded[reached:]) == {(0.4, 0.25)}
