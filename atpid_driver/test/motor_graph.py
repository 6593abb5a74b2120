# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A motor node, in this process or its own, and a node that commands it, for the tests that run over real DDS."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import nan
from typing import Any

from atpid_interfaces.msg import CeilingCommand, CeilingState, Event
from builtin_interfaces.msg import Time as TimeMsg
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from spun import Apart
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from atpid_driver.nodes.motor_node import MotorNode

SIMULATED: dict[str, Any] = {
    "backend": "simulated",
    "lowest": 0.017,
    "highest": 1.0,
    "speed": 0.3,
    "initial_height": 0.017,
}
#: Time from one command to the next [s].
BLOCK = 0.05


def arguments(**parameters: object) -> list[str]:
    """Return the parameters as arguments of a node."""
    return ["--ros-args", *(word for name, value in parameters.items() for word in ("-p", f"{name}:={value}"))]


@contextmanager
def motor_process(**parameters: object) -> Iterator["subprocess.Popen[str]"]:
    """Run the motor node as `ros2 run` starts it; kill it at the end."""
    command = [sys.executable, "-m", "atpid_driver.nodes.motor_node", *arguments(**parameters)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


class Stand(Apart):
    """A motor node and a node that commands it, in one context on one executor."""

    def __init__(self) -> None:
        super().__init__()
        self.states: list[CeilingState] = []
        self.events: list[Event] = []
        self.statuses: list[DiagnosticStatus] = []
        self.peer.create_subscription(CeilingState, "ceiling/state", self.states.append, 100)
        self.peer.create_subscription(Event, "events", self.events.append, 100)
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", lambda m: self.statuses.extend(m.status), 10)
        self.commands = self.peer.create_publisher(CeilingCommand, "ceiling/command", 10)

    def motor(self, **parameters: Any) -> MotorNode:
        node: MotorNode = self.make(MotorNode, SIMULATED | parameters)
        return node

    @property
    def state(self) -> CeilingState:
        """The last state; unlike any published one where there is none."""
        return self.states[-1] if self.states else CeilingState(mode=99)

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def until(self, happened: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        due = time.monotonic()

        def act_in_time() -> None:
            nonlocal due
            if time.monotonic() >= due:
                act()
                due = time.monotonic() + BLOCK  # as the loop does: a flood starves the port's thread

        super().until(happened, act_in_time)

    def until_mode(self, mode: int, act: Callable[[], None] = lambda: None) -> None:
        self.until(lambda: self.state.mode == mode, act)

    def until_moving(self, height: float, act: Callable[[], None]) -> None:
        self.until(lambda: self.state.mode == CeilingState.MOVING and self.state.target == height, act)

    def until_at(self, height: float) -> None:
        """Wait until the motor holds `height` [m]; arm it again where this process stood still past the heartbeat."""

        def arrived() -> bool:
            state = self.state
            if state.mode == CeilingState.FAULT:
                self.states.clear()
                self.trigger("rearm")
            return bool(state.mode == CeilingState.HOLDING and abs(state.height - height) < 3e-3)

        self.until(arrived)

    def more_states(self, count: int, act: Callable[[], None] = lambda: None) -> set[int]:
        """Wait for so many further states; return their modes."""
        self.states.clear()
        self.until(lambda: len(self.states) >= count, act)
        return {state.mode for state in self.states}

    def command(self, height: float, stamp: float, sequence: int = 1, *, handshake: bool = False) -> None:
        seconds = int(stamp)
        header = Header(stamp=TimeMsg(sec=seconds, nanosec=round((stamp - seconds) * 1e9)), frame_id="selector_node")
        self.commands.publish(CeilingCommand(header=header, handshake=handshake, sequence=sequence, height=height))

    def handshake(self) -> CeilingState:
        self.until(lambda: self.states, lambda: self.command(nan, 0.0, 0, handshake=True))
        self.until(lambda: self.peer.count_publishers("events"))
        return self.states[0]

    def ask(self, height: float, stamp: float, sequence: int = 1) -> CeilingState:
        """Command in lockstep, and wait for the state that answers."""
        count = len(self.states)
        self.command(height, stamp, sequence)
        self.until(lambda: len(self.states) > count)
        return self.states[-1]

    def until_quiet(self) -> None:
        """Take in what is still on its way in lockstep; in real time the motor publishes on."""
        count = -1
        while count != len(self.states):
            count = len(self.states)
            for _ in range(5):
                self.executor.spin_once(timeout_sec=0.02)

    def trigger(self, name: str) -> Trigger.Response:
        """Call `stop` or `rearm` of the motor node."""
        return self.call(f"motor_node/{name}")

    def change(self, transition: int) -> bool:
        """Ask for a lifecycle transition; return whether it succeeded."""
        asked = self.call("motor_node/change_state", ChangeState, transition=Transition(id=transition))
        return bool(asked.success)

    def close_motor(self) -> None:
        """End the motor node while its board is still there."""
        for node in self.executor.get_nodes():
            if isinstance(node, MotorNode):
                self.executor.remove_node(node)
                node.destroy_node()
