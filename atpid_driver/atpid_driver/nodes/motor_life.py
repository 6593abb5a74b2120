# SPDX-License-Identifier: Apache-2.0
"""The motor node's life: lifecycle transitions that never fail in silence and leave the motor off when they fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from atpid_common.nodes.lifecycle_node import EnduringLifecycleNode
from atpid_driver.motor import MotorError

_WAYS = {
    "unconfigured": "configure and activate it",
    "inactive": "activate it",
    "finalized": "it was shut down for good; start it again",
}


class MotorLife(EnduringLifecycleNode):
    """A lifecycle node whose transitions are `_configure`, `_activate`, `_deactivate` and `_let_go` of its subclass."""

    def __init__(self, name: str, **kwargs: Any) -> None:
        """Begin unconfigured."""
        super().__init__(name, **kwargs)
        self._last_error = ""

    def _configure(self) -> None:
        raise NotImplementedError

    def _activate(self) -> None:
        raise NotImplementedError

    def _deactivate(self) -> None:
        raise NotImplementedError

    def _let_go(self) -> None:
        raise NotImplementedError

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open and identify; motor off."""
        return self._transition("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Arm and home; motor on while it moves."""
        return self._transition("activate", self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and disarm; motor off."""
        return self._transition("deactivate", self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the port; motor off."""
        return self._transition("clean up", self._let_go)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the port from any state; motor off."""
        return self._transition("shut down", self._let_go)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured with the motor off, so that the node stays alive and can be configured again."""
        self._let_go()
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, verb: str, act: Callable[[], None]) -> TransitionCallbackReturn:
        """Do `act`; what it refuses is logged and fails the transition, what it breaks is logged and is an error."""
        try:
            act()
        except MotorError as error:
            self._complain(f"cannot {verb}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # rclpy drops exceptions of transitions without a word
            self.get_logger().fatal(f"cannot {verb}: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        self._last_error = ""
        return TransitionCallbackReturn.SUCCESS

    def _way_to_active(self) -> str:
        """Return the lifecycle state, and what leads from it to an active node, in words."""
        label = str(self._state_machine.current_state[1])
        return f"{label}: {_WAYS.get(label, 'activate it')}"

    def _complain(self, text: str) -> None:
        """Log a complaint once, not at every retry."""
        if text != self._last_error:
            self.get_logger().error(text)
        self._last_error = text

    def destroy_node(self) -> None:
        """Motor off, port closed, then the node's own end."""
        self._let_go()
        self.leave_graph()

    def leave_graph(self) -> None:
        """End the node itself; rclpy leaves the state machine alive, and with it the node's name in the graph."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()
