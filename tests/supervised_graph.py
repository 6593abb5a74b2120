# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The real-time bench with its supervisor, as processes, and a node that collects what it publishes."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingState, Event, SupervisorState
from graph_runs import parameters, scene_file
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from atpid_common.nodes.messages import EVENTS_KEPT, STATES
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of


class Watch(Node):
    """Collects states of supervisor and motor, and the events, each with the steady time of its receipt [s]."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.supervisor: list[tuple[float, SupervisorState]] = []
        self.ceiling: list[CeilingState] = []
        self.events: list[tuple[float, Event]] = []
        self.create_subscription(SupervisorState, "supervisor/state", self._keep(self.supervisor), STATES)
        self.create_subscription(CeilingState, "ceiling/state", self.ceiling.append, STATES)
        self.create_subscription(Event, "events", self._keep(self.events), EVENTS_KEPT)

    def _keep(self, kept: list[Any]) -> Callable[[Any], None]:
        return lambda message: kept.append((time.monotonic(), message))

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
    """The nodes of the real-time bench on a scene, with changes of its keys and of the supervisor's parameters."""

    def __init__(self, scene: Path, folder: Path, supervisor: dict[str, Any], **changes: Any) -> None:
        _, given = parameters(scene_file(scene, folder, **changes), folder, lockstep=False)
        given["supervisor_node"] |= supervisor
        write_parameters(given, folder / "parameters.yaml")
        self.nodes = Processes(commands_of(folder / "parameters.yaml"), folder, restarts=1)
        self.executor, self.watch = SingleThreadedExecutor(), Watch()
        self.executor.add_node(self.watch)

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
