# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid ros lifecycle NODE TRANSITION`: what `ros2 lifecycle set` does where there is one."""

import argparse
import math
import time
from collections.abc import Callable
from functools import partial

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from atpid_common.arguments import graph_name
from atpid_common.errors import DONE, InputError
from atpid_common.interrupt import Interrupt
from atpid_common.nodes.node_main import command_node
from atpid_common.waiting import announced

TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
TURN = 0.1  # how soon a signal is noticed [s]
ANSWER = 2.0  # how long a node may take to answer before it is asked again [s]


class _Lifecycle:
    """The lifecycle services of one node; every wait ends with KeyboardInterrupt after a signal."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, interrupt: Interrupt, name: str) -> None:
        self._executor, self._interrupt = executor, interrupt
        self._change = node.create_client(ChangeState, f"{name}/change_state")
        self._get = node.create_client(GetState, f"{name}/get_state")

    def state(self) -> str:
        """Return the node's state; asked again where no answer comes, since discovery may lose the first ones."""
        while True:
            answer = self._get.call_async(GetState.Request())
            if self._spin(answer.done, ANSWER):
                return str(answer.result().current_state.label)

    def change(self, transition: str) -> bool:
        """Make a transition; return whether the node made it."""
        before, request = self.state(), ChangeState.Request(transition=Transition(id=TRANSITIONS[transition]))
        while True:
            answer = self._change.call_async(request)
            if self._spin(answer.done, ANSWER):
                return bool(answer.result().success)
            if self.state() != before:  # made, and the answer was lost
                return True

    def wait(self) -> None:
        """Wait for both services."""
        self._spin(lambda: self._change.service_is_ready() and self._get.service_is_ready(), math.inf)

    def _spin(self, happened: Callable[[], bool], seconds: float) -> bool:
        """Spin until something has happened, or for `seconds` [s]; return whether it has."""
        deadline = time.monotonic() + seconds
        while not happened() and time.monotonic() < deadline:
            if self._interrupt.received:
                raise KeyboardInterrupt
            self._executor.spin_once(timeout_sec=TURN)
        return happened()


def run(given: argparse.Namespace) -> int:
    """Make the transition, print the node's state; return the exit status. Raises InputError where it is refused."""
    name, transition = given.node, given.transition
    caller = partial(Node, "lifecycle_caller", start_parameter_services=False)
    with Interrupt() as interrupt, command_node(caller) as (node, executor):
        interrupt.defer()
        lifecycle = _Lifecycle(node, executor, interrupt, name)
        with announced(f"waiting for the lifecycle services of {name}"):
            lifecycle.wait()
        done, state = lifecycle.change(transition), lifecycle.state()
        if not done:
            raise InputError(f"{name} did not {transition} and is {state}; its log has the reason")
        print(f"{name}: {state}", flush=True)
    return DONE


#: Arguments of the example in the help.
EXAMPLE = "/motor_node configure"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("node", type=graph_name, help="name of the lifecycle node, for example /motor_node")
    parser.add_argument("transition", choices=tuple(TRANSITIONS), help="what it shall do")
