# SPDX-License-Identifier: Apache-2.0
"""The supervisor's permission to move, as the motor node has it: withdrawn by a message, or by none for too long."""

import time
from collections.abc import Callable

from atpid_interfaces.msg import SupervisorState
from rclpy.node import Node

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import STATES

TOPIC = "supervisor/state"


class MotionPermit:
    """Whether the motor may move now; always, where it is not supervised."""

    def __init__(self, node: Node, on_stop: Callable[[str], None], timeout: float, *, supervised: bool) -> None:
        """Subscribe where it is supervised; on_stop: called with the reason of a stop, by each message that has one.

        timeout: silence of the supervisor that withdraws the permission [s].
        """
        self._supervised, self._timeout, self._on_stop = supervised, timeout, on_stop
        self._permitted, self._received = False, 0.0  # steady [s]
        self.ending = False  # the supervisor ends in order
        self._reason = "no supervisor has been found yet"
        if supervised:
            subscribe(node, SupervisorState, TOPIC, self._receive, STATES)

    @property
    def granted(self) -> bool:
        """Whether the motor may move, and its heartbeat go on."""
        return not self._supervised or (self._permitted and not self._silent)

    @property
    def reason(self) -> str:
        """Why it may not move, in a few words."""
        return "the supervisor is silent" if self._permitted and self._silent else self._reason

    @property
    def _silent(self) -> bool:
        return time.monotonic() - self._received > self._timeout

    def _receive(self, state: SupervisorState) -> None:
        self._received = time.monotonic()
        self._permitted, self._reason = bool(state.permit), str(state.reason)
        self.ending = state.state == SupervisorState.SHUTDOWN
        if state.stop:
            self._on_stop(self._reason)
