# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the running graph that end and are started again: the simulated motor, and the recorder."""

import math
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingState, Event, PlantTruth
from graph_runs import parameters, scene_file
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES
from atpid_control.runs.recover import repair
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.processes import NodeProcess, Processes
from atpid_control.stand.running import commands_of

pytestmark = pytest.mark.slow

STEADY = {"duration": 90.0, "steady_window": [80.0, 90.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [90.0, 0.015]]}
SHORT = {"duration": 12.0, "steady_window": [8.0, 12.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [12.0, 0.015]]}


class Watch(Node):
    """Collects the plant's true ceiling, the motor's states and the events."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.true: list[float] = []
        self.states: list[CeilingState] = []
        self.events: list[Event] = []
        self.create_subscription(PlantTruth, "plant/truth", self.on_truth, BLOCKS)
        self.create_subscription(CeilingState, "ceiling/state", self.on_state, STATES)
        self.create_subscription(Event, "events", self.events.append, EVENTS)

    def on_truth(self, truth: PlantTruth) -> None:
        if not truth.handshake:
            self.true.append(truth.ceiling[-1])

    def on_state(self, state: CeilingState) -> None:
        if not state.handshake:
            self.states.append(state)

    def stale(self) -> list[Event]:
        """The reports of a silent partner so far."""
        return [event for event in self.events if event.kind == Event.STALE]

    def settled(self) -> bool:
        """Whether the ceiling has been opened and is at rest."""
        state = self.states[-1] if self.states else CeilingState()
        return state.mode == CeilingState.HOLDING and bool(self.true) and self.true[-1] == state.height > 0.2


class Running:
    """The nodes of the real-time bench on a scene, with changes of its keys."""

    def __init__(self, scene: Path, folder: Path, executor: SingleThreadedExecutor, **changes: Any) -> None:
        _, given = parameters(scene_file(scene, folder, **changes), folder, lockstep=False)
        write_parameters(given, folder / "parameters.yaml")
        self.folder, self.executor = folder, executor
        self.commands = dict(commands_of(folder / "parameters.yaml"))
        self.nodes = Processes(self.commands.items(), folder)

    def until(self, happened: Callable[[], object], timeout: float = 100.0) -> None:
        deadline = time.monotonic() + timeout
        while not happened():
            assert time.monotonic() < deadline, "it did not happen"
            self.executor.spin_once(timeout_sec=0.05)

    def again(self, name: str) -> None:
        self.nodes.nodes.append(NodeProcess(name, self.commands[name], self.folder / f"{name}_again.log"))


Start = Callable[..., tuple[Running, Watch]]


@pytest.fixture
def graph(scenes: Path, tmp_path: Path) -> Iterator[Start]:
    """Start the real-time bench's nodes on a scene; return them and a watch."""
    with own_domain():
        rclpy.init()
        executor, watch = SingleThreadedExecutor(), Watch()
        executor.add_node(watch)
        made: list[Running] = []

        def start(**changes: Any) -> tuple[Running, Watch]:
            made.append(Running(scenes / "thesis_4_3.yaml", tmp_path, executor, **changes))
            made[-1].nodes.__enter__()
            return made[-1], watch

        yield start
        for running in made:
            running.nodes.stop()
        watch.destroy_node()
        executor.shutdown()
        rclpy.try_shutdown()


def test_a_simulated_motor_that_is_started_again_does_not_move_the_ceiling(graph: Start) -> None:
    running, watch = graph(**STEADY)
    running.until(watch.settled)
    height, before = watch.true[-1], len(watch.true)
    running.nodes["motor_node"].stop()
    seen = len(watch.states)
    running.again("motor_node")
    running.until(lambda: any(state.mode == CeilingState.HOLDING for state in watch.states[seen:]))
    blocks = len(watch.true)
    running.until(lambda: len(watch.true) >= blocks + 20)
    assert min(watch.true[before:]) > height - 1e-6
    reported = [state.height for state in watch.states[seen:] if not math.isnan(state.height)]
    assert min(reported) == pytest.approx(height, abs=1e-6)


def test_a_recorder_that_is_killed_is_reported_and_the_plant_ends(graph: Start, tmp_path: Path) -> None:
    running, watch = graph(**SHORT)
    running.until(watch.settled)
    recorder = running.nodes["recorder_node"]
    recorder.process.send_signal(signal.SIGKILL)
    # of the plant's: the nodes that then get no samples from it report that as well, on a busy machine before it
    running.until(lambda: any(event.node == "plant_node" for event in watch.stale()))
    assert any("recorder" in event.text for event in watch.stale() if event.node == "plant_node")
    running.until(lambda: running.nodes["plant_node"].status is not None)
    assert running.nodes["plant_node"].status == 0
    running.until(lambda: Event.FINISHED in {event.kind for event in watch.events})
    assert repair(tmp_path / "bag").verified.by_topic["/sensors/laser"] > 20
