# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_common.nodes.lifecycle NODE TRANSITION`: what `ros2 lifecycle set` does where there is one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from atpid_common.cli import guarded
from atpid_common.errors import DONE, InputError
from atpid_common.interrupt import Interrupt
from atpid_common.waiting import announced

TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
TURN = 0.1  # how soon a signal is noticed [s]


class TransitionRefusedError(InputError):
    """The node did not make the transition; its log has the reason."""


class _Caller:
    """Calls services of one node until Ctrl-C."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, interrupt: Interrupt, name: str) -> None:
        self._node, self._executor, self._interrupt, self._name = node, executor, interrupt, name

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of NODE/`service`; raise KeyboardInterrupt where none comes before a signal."""
        client = self._node.create_client(kind, f"{self._name}/{service}")
        with announced(f"waiting for the service {client.srv_name}"):
            self._until(client.service_is_ready)
        answer = client.call_async(request)
        with announced(f"waiting for the answer of {client.srv_name}"):
            self._until(answer.done)
        return answer.result()

    def _until(self, happened: Any) -> None:
        while not happened():
            if self._interrupt.received:
                raise KeyboardInterrupt
            self._executor.spin_once(timeout_sec=TURN)


def change(name: str, transition: str) -> int:
    """Make the transition, print the node's state; return the exit status. Raises TransitionRefusedError."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    with Interrupt() as interrupt:
        interrupt.defer()
        node, executor = Node("lifecycle_caller", start_parameter_services=False), SingleThreadedExecutor()
        executor.add_node(node)
        try:
            caller = _Caller(node, executor, interrupt, name)
            request = ChangeState.Request(transition=Transition(id=TRANSITIONS[transition]))
            done = caller.call(ChangeState, "change_state", request).success
            state = caller.call(GetState, "get_state", GetState.Request()).current_state.label
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
    if not done:
        raise TransitionRefusedError(f"{name} did not {transition} and is {state}; its log has the reason")
    print(f"{name}: {state}")
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m atpid_common.nodes.lifecycle", description=__doc__)
    parser.add_argument("node", help="name of the lifecycle node, for example /motor_node")
    parser.add_argument("transition", choices=tuple(TRANSITIONS), help="what it shall do")

    def run() -> int:
        given = parser.parse_args(argv)
        return change(given.node, given.transition)

    return guarded(run)


if __name__ == "__main__":
    sys.exit(main())
