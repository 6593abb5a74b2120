# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The real-time bench as processes, one supervisor after the other, and a node that collects what they publish."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, PlantTruth, SupervisorState
from graph_runs import parameters, scene_file
from rclpy.node import Node
from std_srvs.srv import Trigger

from atpid_common.nodes.messages import BLOCKS, EVENTS_KEPT, STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import SUPERVISOR
from atpid_control.stand.processes import NodeProcess, Processes
from atpid_control.stand.running import PLAIN, command_of, commands_of


class Watch(Node):
    """Collects states of supervisor and motor, the true ceiling, and the events with the steady time of receipt [s]."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.supervisor: list[tuple[float, SupervisorState]] = []
        self.asked: list[float] = []  # heights the selector has sent the ceiling to [m]
        self.ceiling: list[CeilingState] = []
        self.true: list[float] = []  # the plant's ceiling, at the end of each block [m]
        self.events: list[tuple[float, Event]] = []
        self.plant = False  # whether it has published where its ceiling stands
        self.create_subscription(SupervisorState, "supervisor/state", self._keep(self.supervisor), STATES)
        self.create_subscription(CeilingCommand, "ceiling/command", lambda sent: self.asked.append(sent.height), STATES)
        self.create_subscription(CeilingState, "ceiling/state", self.ceiling.append, STATES)
        self.create_subscription(PlantTruth, "plant/truth", self._on_truth, BLOCKS)
        self.create_subscription(Event, "events", self._keep(self.events), EVENTS_KEPT)

    def _keep(self, kept: list[Any]) -> Callable[[Any], None]:
        return lambda message: kept.append((time.monotonic(), message))

    def _on_truth(self, truth: PlantTruth) -> None:
        self.plant = True
        if not truth.handshake:
            self.true.append(truth.ceiling[-1])

    def clear(self) -> None:
        """Drop what was collected so far."""
        for kept in (self.supervisor, self.asked, self.ceiling, self.true, self.events):
            kept.clear()

    @property
    def state(self) -> SupervisorState:
        """The supervisor's last state."""
        return self.supervisor[-1][1] if self.supervisor else SupervisorState()

    @property
    def mode(self) -> int:
        """The motor's last mode."""
        return int(self.ceiling[-1].mode) if self.ceiling else CeilingState.UNCONFIGURED

    def when(self, kind: str, words: str = "") -> float:
        """Return when the last event of a kind with these words came, steady [s]; 0: none did."""
        times = [at for at, event in self.events if event.kind == kind and words in event.text]
        return times[-1] if times else 0.0


class Supervised:
    """The nodes of the real-time bench on a scene with changes of its keys; the supervisor comes with `supervise`."""

    def __init__(self, scene: Path, folder: Path, **changes: Any) -> None:
        _, self.given = parameters(scene_file(scene, folder, **changes), folder, lockstep=False)
        self.folder, self._supervisors = folder, 0
        file = folder / "parameters.yaml"
        write_parameters(self.given, file)
        self.commands = dict(commands_of(file))
        others = [(name, command) for name, command in self.commands.items() if name != SUPERVISOR.name]
        self.nodes = Processes(others, folder, restarts=1)
        self.executor, self.watch = TurnExecutor(), Watch()
        self.executor.add_node(self.watch)

    def supervise(self, **changes: Any) -> NodeProcess:
        """Start a supervisor with changes of its parameters; what was collected before it is dropped."""
        self.spin(0.2)  # what the one before has published
        self.watch.clear()
        self._supervisors += 1
        file, log = (self.folder / f"supervisor-{self._supervisors}.{ending}" for ending in ("yaml", "log"))
        write_parameters({SUPERVISOR.name: self.given[SUPERVISOR.name] | changes}, file)
        self.nodes.nodes.insert(1, NodeProcess(*command_of(SUPERVISOR, file, PLAIN), log))  # stopped after the motor
        return self.nodes[SUPERVISOR.name]

    def unsupervise(self) -> None:
        """End the supervisor, where there is one."""
        for node in [node for node in self.nodes.nodes if node.name == SUPERVISOR.name]:
            node.stop()
            self.nodes.nodes.remove(node)

    def again(self, name: str) -> None:
        """Start a node that has ended again, in its place."""
        place = self.nodes.nodes.index(self.nodes[name])
        self.nodes.nodes[place] = NodeProcess(name, self.commands[name], self.folder / f"{name}.log")

    def until(self, happened: Callable[[], object], timeout: float = 100.0) -> None:
        """Spin until it has happened."""
        deadline = time.monotonic() + timeout
        while not happened():
            assert time.monotonic() < deadline, f"it did not happen; {self.watch.state}"
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds: float) -> None:
        """Spin for some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, kind: Any, name: str) -> Any:
        """Call a service without arguments; return its answer."""
        client = self.watch.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = client.call_async(kind.Request())
        self.until(answer.done)
        return answer.result()

    def arm(self, service: str = "motor_node/rearm") -> None:
        """Arm the motor; again where it is refused, since a busy machine withdraws the permission or misses a beat."""

        def armed() -> bool:
            if self.watch.mode in (CeilingState.FAULT, CeilingState.DISARMED):
                self.call(Trigger, service)
                self.spin(0.2)
            return self.watch.mode in (CeilingState.MOVING, CeilingState.HOLDING)

        self.until(armed)

    def close_nodes(self) -> None:
        """Stop the nodes in order."""
        self.nodes.stop()

    def close(self) -> None:
        """Stop everything."""
        self.nodes.stop()
        self.executor.shutdown()
        self.watch.destroy_node()
