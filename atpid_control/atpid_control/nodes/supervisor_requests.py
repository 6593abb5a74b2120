# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the supervisor asks: each node whether it answers, motor and exciter to stop and to arm.

A node whose executor hangs does not reply to a standard service: a lifecycle node is asked for its state, another one
for no parameters at all.
"""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingState
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.handshake import Question
from atpid_common.nodes.messages import STEADY
from atpid_control.supervision.states import NodeLiveness

#: Between two questions [s].
_PERIOD = 0.1
_LIFECYCLE_NODES = ("motor_node", "excitation_node", "labjack_node", "ni_node")


class NodeQuestions:
    """Asks all nodes, one question at a time to each."""

    def __init__(self, node: Node, answers: NodeLiveness) -> None:
        self._node, self._answers = node, answers
        self._questions = [self._question(name) for name in answers.nodes]
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        self._claims = {name: f"@atpid/{domain}{node.resolve_service_name(name)}" for name in answers.nodes}
        self._seen: set[str] = set()

    def ask(self, now: float) -> None:
        """Ask every node whose turn it is at the steady time `now` [s]."""
        for question, request in self._questions:
            question.ask(request, now, _PERIOD)

    def ended(self) -> set[str]:
        """Return the nodes whose processes have run on this machine and have ended, by the names that they claim."""
        running = self._running()
        self._seen |= running
        return self._seen - running

    def runs_here(self, name: str) -> bool:
        """Return whether a node has a process on this machine, which has got so far as to claim its name."""
        return name in self._running()

    def _running(self) -> set[str]:
        claims = set(Path("/proc/net/unix").read_text(errors="replace").split())
        return {name for name, claim in self._claims.items() if claim in claims}

    def in_words(self, name: str) -> str:
        """Return what a silent node does, in words: whether its process has ended or only does not answer."""
        if name in self.ended():
            return "has ended, and does not answer"
        return (
            "does not answer" if name in self._seen else "runs on another machine, or not at all, and does not answer"
        )

    def _question(self, name: str) -> tuple[Question, object]:
        kind, service = (GetState, "get_state") if name in _LIFECYCLE_NODES else (GetParameters, "get_parameters")
        client = self._node.create_client(kind, f"{name}/{service}")
        return Question(client, partial(self._answered, name)), kind.Request()

    def _answered(self, name: str, _answer: object) -> None:
        self._answers.answered(name, time.monotonic())


MOTOR, EXCITER = "motor_node", "excitation_node"
#: Until an answer is given up: of its lifecycle state, a stop, all that arms it; and until its state shows it [s].
_STATE, _STOP, _ARM, _SHOWN = 1.0, 1.5, 4.0, 1.0
#: A motor's board that has not answered for so long has hung: a lost answer is asked for again sooner [s].
_UNKNOWN = 0.35
#: What it does once it is armed.
_ARMED = {
    CeilingState.HOMING: "homing has begun",
    CeilingState.HOLDING: "the ceiling holds",
    CeilingState.MOVING: "the ceiling moves",
}


class DeviceRequests:
    """Its methods wait without blocking: they are for callbacks of a reentrant group. Times are steady."""

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name, self._clock = node, name, STEADY
        self._stop = node.create_client(Trigger, f"{name}/stop")

    async def stop(self) -> str:
        """Disarm it. Return why that is not confirmed, one line; empty: the device has confirmed it."""
        answer = await self._answer(self._stop, Trigger.Request(), _STOP)
        if answer is None:
            return f"{self._name} does not answer"
        return "" if answer.success else str(answer.message)

    async def pause(self, seconds: float) -> None:
        """Wait for so long [s]; not at all where that is negative."""
        if seconds > 0.0:
            await self._within(Future(), seconds)

    async def _answer(self, client: Client, request: object, limit: float) -> Any:
        """Return the answer; None where there is none within `limit` [s]."""
        if limit <= 0.0 or not client.service_is_ready():
            return None
        future = client.call_async(request)
        await self._within(future, limit)
        if not future.done() or future.exception() is not None:
            client.remove_pending_request(future)
            return None
        return future.result()

    async def _within(self, future: Future, limit: float) -> None:
        """Wait until a future is done, for `limit` [s] at most."""
        over = Future()

        def end(_done: object = None) -> None:
            if not over.done():
                over.set_result(None)

        future.add_done_callback(end)
        timer = self._node.create_timer(limit, end, clock=self._clock)
        await over
        self._node.destroy_timer(timer)


class MotorRequests(DeviceRequests):
    """Those of the motor, whose state shows whether it is armed."""

    def __init__(self, node: Node) -> None:
        super().__init__(node, MOTOR)
        self._get_state = node.create_client(GetState, f"{MOTOR}/get_state")
        self._rearm = node.create_client(Trigger, f"{MOTOR}/rearm")
        self._state, self._armed = CeilingState(), Future()
        self._answered, self._late = 0.0, False  # when its board answered last, and whether that is too long ago [s]

    def on_state(self, state: CeilingState, now: float) -> str:
        """Take a state of the ceiling at `now` [s]. Return why the motor has just gone off; empty: it has not.

        A board that does not answer has perhaps: its last state is repeated then, with the stamp it had.
        """
        before, self._state = self._state, state
        if state.header.stamp != before.header.stamp or state.mode not in _ARMED:
            self._answered = now
        late, self._late = self._late, now - self._answered > _UNKNOWN
        if state.mode in _ARMED and not self._armed.done():
            self._armed.set_result(None)
        if state.mode == CeilingState.FAULT != before.mode:
            return f"motor off: {state.fault}"
        if state.mode in _ARMED:
            return f"no answer of the motor's board for {_UNKNOWN:g} s" if self._late and not late else ""
        return "motor off" if before.mode in _ARMED else ""

    async def answers(self) -> bool:
        """Return whether its node answers now."""
        return await self._answer(self._get_state, GetState.Request(), _STATE) is not None

    async def arm(self) -> tuple[bool, str]:
        """Arm the motor; return whether it is armed, and what it does or why it is not."""
        answer = await self._answer(self._rearm, Trigger.Request(), _ARM)
        if answer is None:
            return False, f"{MOTOR} has not answered within {_ARM:g} s"
        if not answer.success:
            return False, str(answer.message)
        self._armed = Future()
        await self._within(self._armed, _SHOWN)
        if self._state.mode in _ARMED:
            return True, _ARMED[self._state.mode]
        cause = f": {self._state.fault}; remove the cause" if self._state.fault else ""
        return False, f"the motor is off again{cause}"
