# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant node at its ends: a plant that fails, a machine too slow, and a recorder that is waited for."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from graph_runs import scene_file
from node_graph import NodeGraph
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from atpid_common.nodes import recorder_watch
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, STATUS, nanoseconds_of, time_of
from atpid_sim.nodes.plant_node import PlantNode
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene

ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FIELDS = ("excitation_amplitude", "excitation_frequency", "input_energy", "beam_loss", "contact_loss",
          "ceiling_work", "stored_energy")  # fmt: skip

TOPICS = ["/sensors/laser", "/plant/truth", "/events", "/excitation", "/ceiling/command", "/ceiling/state"]


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


class Graph(NodeGraph):
    """A plant node, whose plant is an oscillator. The peer is identifier, selector and motor: it answers each block."""

    def __init__(
        self, path: Path, *, lockstep: bool = True, expect_recorder: bool = False, **oscillator: float
    ) -> None:
        super().__init__()
        self.oscillator: Oscillator
        given = {"scene": str(path), "lockstep": lockstep, "expect_recorder": expect_recorder}
        self.plant = self.make(PlantNode, given, make_plant=partial(self._oscillator, oscillator))
        self.blocks: list[SampleBlock] = []
        self.handshakes = 0
        self.heard = self.collect(Event, "events", EVENTS)
        self.states = self.peer.create_publisher(CeilingState, "ceiling/state", STATES)
        self.status = self.peer.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self.blocks_in = self.peer.create_subscription(SampleBlock, "sensors/laser", self._on_block, BLOCKS)

    def _oscillator(self, given: dict[str, float], scene: Scene) -> Oscillator:
        self.oscillator = Oscillator(scene, **given)
        return self.oscillator

    def _on_block(self, block: SampleBlock) -> None:
        state = CeilingState(handshake=block.handshake, mode=CeilingState.MOVING, height=0.1, target=0.3, speed=0.25)
        state.header.frame_id = block.header.frame_id
        if block.handshake:
            self.handshakes += 1
        else:
            self.blocks.append(block)
            last = (len(block.data) // 2 - 1) / block.rate
            state.header.stamp = time_of(nanoseconds_of(block.header.stamp) + round(1e9 * last))
        self.states.publish(state)

    @property
    def events(self) -> list[Event]:
        return [event for event in self.heard if not event.handshake]

    def found(self, kind: str) -> list[Event]:
        return [event for event in self.events if event.kind == kind]

    def record(self, *, recording: bool, received: int) -> None:
        """Publish the status of a recorder that has heard everything so often."""
        counts = [received] * len(TOPICS)
        status = RecorderStatus(recording=recording, bag="/bags/run", topics=TOPICS, received=counts, written=counts)
        self.status.publish(status)

    def more_blocks(self) -> None:
        """Wait for some blocks more."""
        before = len(self.blocks)
        self.until(lambda: len(self.blocks) > before + 2)

    def ended(self) -> int:
        """Wait for the end; return the status."""
        self.until(self.plant.done.done)
        return int(self.plant.done.result())


Start = Callable[..., Graph]


@pytest.fixture
def start(scenes: Path, tmp_path: Path) -> Iterator[Start]:
    with ExitStack() as stack:

        def begin(duration: float = 0.5, **given: Any) -> Graph:
            ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
            changes = {"duration": duration, "steady_window": [0.1, duration], "ceiling": ceiling}
            path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
            return stack.enter_context(closing(Graph(path, **given)))

        yield begin


def test_each_block_waits_for_its_answer_and_the_ceiling_follows_the_state(start: Start) -> None:
    graph = start()
    assert graph.ended() == 0
    graph.until(lambda: len(graph.events) == 2)
    assert [block.first_index for block in graph.blocks] == list(range(0, 500, 50))
    assert (graph.blocks[1].device, graph.blocks[1].header.frame_id) == ("plant:laser", "stand")
    assert graph.oscillator.commanded == [(0.017, 0.0)] + [(0.3, 0.25)] * 9
    kinds = [(event.kind, event.severity) for event in graph.events]
    assert kinds == [(Event.STARTED, Event.INFO), (Event.FINISHED, Event.INFO)]
    begin = graph.events[0]
    assert (begin.value, nanoseconds_of(begin.header.stamp)) == (0.5, 0)
    assert {"scene.yaml:", "0.5", "lockstep"} <= set(begin.text.split())


def test_a_plant_that_fails_alarms_and_ends_with_status_3(start: Start) -> None:
    graph = start(fails_at=0.2)
    assert graph.ended() == 3
    graph.until(lambda: len(graph.events) == 3)
    failed, finished = graph.events[1:]
    assert (failed.kind, failed.severity) == (Event.FAILED, Event.ALARM)
    assert (finished.kind, finished.severity) == (Event.FINISHED, Event.ALARM)
    assert failed.text == graph.plant.failure
    assert failed.text.endswith(f"0.2 s: {Outcome.ESCAPED.sentence}")


def test_in_real_time_stamps_are_the_start_plus_index_over_rate(start: Start) -> None:
    begun = time.time_ns()
    graph = start(lockstep=False)
    assert graph.ended() == 0
    graph.until(lambda: len(graph.blocks) == 10)
    stamps = [nanoseconds_of(block.header.stamp) for block in graph.blocks]
    assert stamps[0] >= begun
    assert np.diff(stamps).tolist() == [50_000_000] * 9
    assert time.time_ns() - stamps[0] >= 500_000_000


def test_a_machine_too_slow_for_real_time_is_reported_once_and_nothing_is_left_out(start: Start) -> None:
    graph = start(seconds_a_block=0.07, lockstep=False)
    graph.ended()
    graph.until(lambda: len(graph.blocks) == 10 and len(graph.events) == 3)
    assert [event.kind for event in graph.events] == [Event.STARTED, Event.BEHIND, Event.FINISHED]
    assert graph.events[1].value > 0.05
    assert [block.first_index for block in graph.blocks] == list(range(0, 500, 50))


def test_nothing_starts_before_the_recorder_hears_everything_and_the_end_waits_for_its_bag(start: Start) -> None:
    graph = start(expect_recorder=True)
    graph.until(lambda: graph.handshakes > 3 and graph.statuses)
    assert not graph.blocks
    assert "recorder" in graph.plant.waiting_for()
    status = graph.statuses[-1]
    assert (status.name, status.hardware_id) == ("plant_node: simulated plant", "simulated plant")
    assert (status.level, status.message.split()[0]) == (DiagnosticStatus.OK, "waiting")
    assert {value.key: value.value for value in status.values}["scene"] == "scene.yaml"
    graph.record(recording=False, received=9)
    graph.until(lambda: "/bags/run" in graph.plant.waiting_for())  # a bag that is closed does not start a run
    assert not graph.blocks
    graph.record(recording=True, received=1)
    graph.until(lambda: graph.found(Event.FINISHED))
    assert not graph.plant.done.done()
    graph.record(recording=False, received=1)
    assert graph.ended() == 0


def test_a_silent_recorder_is_reported_and_not_waited_for(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_watch, "GONE_AFTER", 0.3)
    graph = start(lockstep=False, expect_recorder=True, duration=100.0)
    graph.until(lambda: graph.handshakes > 3)
    graph.record(recording=True, received=1)
    graph.until(lambda: graph.found(Event.STALE))
    (stale,) = graph.found(Event.STALE)
    assert stale.severity == Event.WARNING
    assert stale.value > 0.3
    assert "/bags/run" in stale.text
    graph.record(recording=True, received=9)
    graph.until(lambda: graph.found(Event.RESUMED))
    graph.until(lambda: len(graph.found(Event.STALE)) == 2)
    graph.oscillator.fails_at = 0.0
    assert graph.ended() == 3  # although the recorder has not reported its bag closed


def test_what_is_waited_for_is_logged_with_the_nodes_that_are_missing(start: Start) -> None:
    graph = start()
    graph.peer.destroy_subscription(graph.blocks_in)
    logs = graph.collect(Log, "/rosout", ROSOUT)
    graph.until(lambda: any("waiting" in log.msg for log in logs))
    (text,) = {log.msg for log in logs if "waiting" in log.msg}
    topics, _, missing = text.partition(";")
    assert topics.split()[-1] == "ceiling/state"
    assert missing.partition(": ")[2].split(", ") == ["identifier_node", "selector_node", "motor_node"]


def test_faults_are_injected_into_a_running_plant_by_its_parameter(start: Start) -> None:
    graph = start(lockstep=False, duration=100.0)
    graph.more_blocks()

    def given(fault: str) -> Any:
        return graph.plant.set_parameters([Parameter("faults", value=[fault])])[0]

    def lost() -> Any:
        """Whether support and beam have no reading at all, some blocks later."""
        graph.more_blocks()
        return np.isnan(np.array(graph.blocks[-1].data).reshape(-1, 2)).all(axis=0).tolist()

    for part in ("motor", "recorder"):
        refused = given(f"{part} off 0 9")
        assert not refused.successful
        ((offered, allowed),) = re.findall(r"given (.*); allowed: (.*), which", refused.reason)
        assert (offered, allowed.split(", ")) == (part, ["support_laser", "beam_laser", "accelerometer", "clock"])
    refused = given("accelerometer off 0 9")
    assert (refused.successful, "sensors.accelerometer" in refused.reason) == (False, True)
    assert given("support_laser off 0 1000").successful
    assert lost() == [True, False]
    assert given("").successful
    assert lost() == [False, False]
    assert np.isfinite(graph.blocks[-1].data).all()
    change = graph.found(Event.PARAMETER)[0].text
    assert change.partition("faults: ")[2] == "[''] -> ['support_laser off 0 1000']"


def test_the_ceiling_is_where_it_is_and_not_where_a_motor_that_fails_reports_it(start: Start) -> None:
    graph = start(lockstep=False, duration=100.0)
    truth, commanded = graph.peer.create_publisher(CeilingState, "ceiling/truth", STATES), graph.oscillator.commanded
    graph.until(lambda: (0.3, 0.25) in commanded and truth.get_subscription_count() == 1)
    truth.publish(CeilingState(mode=CeilingState.MOVING, height=0.4, target=0.4, speed=0.25))
    graph.until(lambda: commanded[-1] == (0.4, 0.25))
    reached = len(commanded)
    graph.more_blocks()  # which the peer has answered with ceiling/state
    assert set(commanded[reached:]) == {(0.4, 0.25)}
