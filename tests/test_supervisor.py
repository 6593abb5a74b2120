# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor in the real-time bench, whose nodes hang or end. Levels and stops: test_supervisor_node.py."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, PlantTruth, SupervisorState
from graph_runs import parameters, scene_file
from node_graph import NodeGraph

from atpid_common.nodes.messages import BLOCKS, EVENTS_KEPT
from atpid_control.runs.read import open_bag
from atpid_control.stand.parameters import NodeDiedError, write_parameters
from atpid_control.stand.parts import SUPERVISOR
from atpid_control.stand.processes import NodeProcess, Processes
from atpid_control.stand.running import PLAIN, command_of, commands_of

#: Longer than all tests take together.
STEADY = {"duration": 900.0, "steady_window": [890.0, 900.0], "amplitude": [[0.0, 0.0], [0.5, 0.015], [900.0, 0.015]]}
#: Silence after which a run is given up, of a node that is started again meanwhile [s].
GIVE_UP = 5.0
ARMED = (CeilingState.MOVING, CeilingState.HOLDING)


class Supervised(NodeGraph):
    """The nodes of the real-time bench as processes, and what they publish; the supervisor comes with `supervise`."""

    def __init__(self, scene: Path, folder: Path) -> None:
        super().__init__()
        _, self.given = parameters(scene_file(scene, folder, **STEADY), folder, lockstep=False)
        self.folder, self._supervisors = folder, 0
        write_parameters(self.given, folder / "parameters.yaml")
        self.commands = dict(commands_of(folder / "parameters.yaml"))
        others = [(name, command) for name, command in self.commands.items() if name != SUPERVISOR.name]
        self.supervisor = self.collect(SupervisorState, "supervisor/state")
        self.asked = self.collect(CeilingCommand, "ceiling/command")  # where the selector has sent the ceiling
        self.ceiling = self.collect(CeilingState, "ceiling/state")
        self.truth = self.collect(PlantTruth, "plant/truth", BLOCKS)
        self.events: list[tuple[float, Event]] = []  # with the steady time of receipt [s]
        self.peer.create_subscription(Event, "events", self._on_event, EVENTS_KEPT)
        self.nodes = Processes(others, folder, restarts=1)
        self.nodes.__enter__()
        self.until(lambda: self.truth)  # until then a motor that may move seeks its height, which is on-time

    def _on_event(self, event: Event) -> None:
        self.events.append((time.monotonic(), event))

    @property
    def state(self) -> SupervisorState:
        """The supervisor's last state."""
        return self.supervisor[-1] if self.supervisor else SupervisorState()

    @property
    def mode(self) -> int:
        """The motor's last mode."""
        return int(self.ceiling[-1].mode) if self.ceiling else CeilingState.UNCONFIGURED

    @property
    def true(self) -> list[float]:
        """The plant's ceiling, at the end of each block [m]."""
        return [truth.ceiling[-1] for truth in self.truth if not truth.handshake]

    def when(self, kind: str, words: str = "") -> float:
        """Return when the last event of a kind with these words came, steady [s]; 0: none did."""
        return max((at for at, event in self.events if event.kind == kind and words in event.text), default=0.0)

    def supervise(self, **changes: Any) -> None:
        """Start a supervisor with changes of its parameters; what was collected before it is dropped."""
        self.spin(0.2)  # what the one before has published
        for kept in (self.supervisor, self.asked, self.ceiling, self.truth, self.events):
            kept.clear()
        self._supervisors += 1
        file, log = (self.folder / f"supervisor-{self._supervisors}.{ending}" for ending in ("yaml", "log"))
        write_parameters({SUPERVISOR.name: self.given[SUPERVISOR.name] | changes}, file)
        self.nodes.nodes.insert(1, NodeProcess(*command_of(SUPERVISOR, file, PLAIN), log))  # stopped after the motor

    def unsupervise(self) -> None:
        """End the supervisor, where there is one."""
        for node in [node for node in self.nodes.nodes if node.name == SUPERVISOR.name]:
            node.stop()
            self.nodes.nodes.remove(node)

    def again(self, name: str) -> None:
        """Start a node that has ended again, in its place."""
        place = self.nodes.nodes.index(self.nodes[name])
        self.nodes.nodes[place] = NodeProcess(name, self.commands[name], self.folder / f"{name}.log")

    def spin(self, seconds: float) -> None:
        """Spin for some time."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end)

    def ended(self) -> NodeProcess:
        """Wait until the supervisor has ended by itself, by an error."""
        supervisor = self.nodes[SUPERVISOR.name]
        self.until(lambda: supervisor.status is not None)
        assert supervisor.status == 2
        return supervisor

    def arm(self, service: str = "motor_node/rearm") -> None:
        """Arm the motor; again where it is refused, since a busy machine withdraws the permission or misses a beat."""

        def armed() -> bool:
            if self.mode in (CeilingState.FAULT, CeilingState.DISARMED):
                self.call(service)
                self.spin(0.2)
            return self.mode in ARMED

        self.until(armed)

    def close(self) -> None:
        """Stop everything."""
        self.nodes.stop()
        super().close()


Start = Callable[..., Supervised]


@pytest.fixture(scope="module")
def graph(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Supervised]:
    """The nodes of one bench, which get one supervisor after the other, in the order of the tests."""
    with closing(Supervised(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("graph"))) as made:
        yield made


@pytest.fixture
def start(graph: Supervised) -> Iterator[Start]:
    def begin(**supervisor: Any) -> Supervised:
        """Return the nodes, once the ceiling is held or moves with a new supervisor's permission."""
        graph.supervise(**supervisor)
        graph.until(lambda: graph.state.state == SupervisorState.READY)
        graph.arm("supervisor_node/rearm")  # which activates it where a test before has stopped it
        return graph

    yield begin
    graph.unsupervise()


def test_a_node_whose_replacement_does_not_come_ends_the_run_with_its_name(start: Start) -> None:
    running = start(give_up=1.0, restart_time=3.0)
    running.nodes["selector_node"].process.kill()
    assert {"selector_node", "3"} <= set(running.ended().reason().split())


def test_nodes_that_hang_or_end_are_named_the_ceiling_held_and_the_motor_off(start: Start, graph: Supervised) -> None:
    """The last test, as the bench where nodes are started again: it ends all nodes, and reads the bag."""
    if graph.nodes["selector_node"].status is not None:  # by the test above
        graph.again("selector_node")
    running = start(give_up=GIVE_UP, restart_time=60.0)
    a_motor_that_is_started_again_does_not_move_the_ceiling(running)
    one_that_hangs_is_named(running, "recorder_node")
    killed_and_started_again(running, "selector_node")
    assert running.call("supervisor_node/check").success
    running.nodes.stop()
    bag = open_bag(running.folder / "bag")
    recorded = {(event.kind, event.text.split()[0]) for _, event in bag.messages("/events")}
    assert {(Event.RESUMED, "selector_node"), (Event.STALE, "recorder_node")} <= recorded
    states = {message.state for _, message in bag.messages("/supervisor/state")}
    assert {SupervisorState.READY, SupervisorState.FAULT} <= states


def a_motor_that_is_started_again_does_not_move_the_ceiling(running: Supervised) -> None:
    def settled() -> bool:
        """Whether the ceiling has been opened and is at rest."""
        return bool(running.mode == CeilingState.HOLDING and running.true) and (
            running.true[-1] == running.ceiling[-1].height > 0.2
        )

    running.until(settled)
    height, before = running.true[-1], len(running.true)
    running.nodes["motor_node"].stop()
    running.spin(0.1)  # what it has still published
    seen = len(running.ceiling)
    running.again("motor_node")
    running.until(lambda: any(state.mode == CeilingState.HOLDING for state in running.ceiling[seen:]))
    blocks = len(running.true)
    running.until(lambda: len(running.true) >= blocks + 20)
    # nowhere but where it was and where the selector, just started again, has sent it since
    lowest = np.nanmin([height, *(asked.height for asked in running.asked)]) - 1e-6
    assert lowest > 0.2
    assert min(running.true[before:]) > lowest
    assert np.nanmin([state.height for state in running.ceiling[seen:]]) > lowest
    running.until(lambda: running.state.state == SupervisorState.READY)
    running.arm()


def one_that_hangs_is_named(running: Supervised, name: str) -> None:
    """Let a node hang: the motor stays off when it is back, until a person arms it."""
    running.nodes[name].process.send_signal(signal.SIGSTOP)
    hung = time.monotonic()
    running.until(lambda: running.when(Event.STALE, name) > hung)
    silent = next(event.value for at, event in running.events if at > hung and event.text.startswith(name))
    assert 0.3 <= silent < 2.0  # 0.45 s of the supervisor's own time; the rest is for a machine with other work
    running.until(lambda: running.state.state == SupervisorState.FAULT and not running.state.permit)
    running.until(lambda: running.mode == CeilingState.FAULT)
    height = running.ceiling[-1].height
    running.nodes[name].process.send_signal(signal.SIGCONT)
    running.until(lambda: running.state.state == SupervisorState.READY)
    running.spin(1.0)
    assert running.mode == CeilingState.FAULT, "a person arms it, not the node that is back"
    assert running.ceiling[-1].height == height
    running.arm()


def killed_and_started_again(running: Supervised, name: str) -> None:
    """Kill a node: it is started again once, and the motor stays off until a person arms it.

    Its replacement is stopped while it loads, as on a busy machine, for longer than a node may hang. That time counts
    again from when it has loaded, in which discovery alone takes seconds on a busy machine.
    """
    supervisor = running.nodes["supervisor_node"]
    killed = time.monotonic()
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    (line,) = running.nodes.check("")
    assert {name, "-9", "60", "0"} <= set(line.split())
    running.nodes[name].process.send_signal(signal.SIGSTOP)
    running.until(lambda: running.state.state == SupervisorState.FAULT)
    place = list(running.state.nodes).index(name)
    running.until(lambda: running.state.silence[place] > GIVE_UP + 1.0)
    assert supervisor.status is None
    running.nodes[name].process.send_signal(signal.SIGCONT)
    running.until(lambda: running.when(Event.RESUMED, name) > killed)
    running.until(lambda: running.state.state == SupervisorState.READY)
    assert supervisor.status is None
    assert running.when(Event.STALE, name) > killed
    assert running.mode == CeilingState.FAULT
    height, seen = running.ceiling[-1].height, len(running.ceiling)
    running.arm()
    # where it stands as it is armed: what the controller commands next moves it by 0.3 m in each second
    armed = next(state for state in running.ceiling[seen:] if state.mode in ARMED)
    assert armed.height == pytest.approx(height, abs=0.05)
    running.nodes[name].process.kill()
    running.until(lambda: running.nodes[name].status is not None)
    with pytest.raises(NodeDiedError, match=rf"{name} .*-9"):
        running.nodes.check("")
