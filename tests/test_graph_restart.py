# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorder of the running graph that ends; nodes that end and are started again: test_supervisor.py."""

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from atpid_interfaces.msg import Event
from graph_runs import parameters, scene_file
from supervised_graph import Watch

from atpid_control.runs.recover import repair
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import Composition
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import NODES
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of

pytestmark = pytest.mark.slow

#: Blocks of 0.05 s before the recorder is killed. The plant calls it gone after 5 s, and goes on to its end.
BLOCKS = 30
SHORT = {"duration": 9.0, "steady_window": [7.0, 9.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [9.0, 0.015]]}


class Running:
    """The bench in real time: plant and recorder are processes, what is between them runs in this one."""

    def __init__(self, scene: Path, folder: Path) -> None:
        _, given = parameters(scene_file(scene, folder, **SHORT), folder, lockstep=False)
        given["motor_node"]["supervised"] = False
        write_parameters(given, folder / "parameters.yaml")
        ends = [NODES[name] for name in ("plant_node", "recorder_node")]
        between = [part for part in NODES.values() if part not in ends]
        self.nodes = Processes(commands_of(folder / "parameters.yaml", ends), folder)
        self.loop = Composition([(part.package, part.name) for part in between], given)
        self.watch = Watch()
        self.loop.executor.add_node(self.watch)

    def until(self, happened: Callable[[], object]) -> None:
        deadline = time.monotonic() + 100.0
        while not happened():
            assert time.monotonic() < deadline, "it did not happen"
            self.loop.executor.spin_once(timeout_sec=0.02)


@pytest.fixture
def running(scenes: Path, tmp_path: Path) -> Iterator[Running]:
    with own_domain():
        made = Running(scenes / "thesis_4_3.yaml", tmp_path)
        with made.loop, made.nodes:
            yield made
            made.watch.destroy_node()


def test_a_recorder_that_is_killed_is_reported_and_the_plant_ends(running: Running, tmp_path: Path) -> None:
    watch, plant = running.watch, running.nodes["plant_node"]

    def reported() -> bool:
        """By the plant: the nodes that then get no samples from it report that as well, on a busy machine before it."""
        stale = [event for _, event in watch.events if event.kind == Event.STALE and event.node == "plant_node"]
        return any("recorder" in event.text for event in stale)

    running.until(lambda: len(watch.true) >= BLOCKS)
    running.nodes["recorder_node"].process.send_signal(signal.SIGKILL)
    running.until(reported)
    running.until(lambda: plant.status is not None)
    assert plant.status == 0
    running.until(lambda: Event.FINISHED in {event.kind for _, event in watch.events})
    assert repair(tmp_path / "bag").verified.by_topic["/sensors/laser"] > 20
