# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node of one device: each failed transition is reported once, and its end releases the device."""

from collections.abc import Callable

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from atpid_driver import DriverError


class DeviceNode(LifecycleNode):
    """Its transitions are `_configure`, `_activate`, `_deactivate` and `_release` of the subclass.

    A DriverError fails the transition, another exception is an error of it; both are passed to `_report`. One that is
    impossible in the node's state, such as `configure` while it is active, is refused.
    """

    _configure: Callable[[], None]
    _activate: Callable[[], None]
    _deactivate: Callable[[], None]
    _release: Callable[[], None]  # in any state

    def __init__(self, name: str, **kwargs: object) -> None:
        super().__init__(name, **kwargs)
        self._last_error = ""
        self._may_retry = True  # whether the last transition may succeed later with the same parameters
        self._starter: Timer | None = None  # of autostart, until the node is active

    def _report(self, text: str) -> None:
        self.get_logger().error(text)

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Open and identify the device."""
        return self._transition("configure", self._configure)

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Start it, and end autostart whatever requested this: a second activation would end the node."""
        outcome = self._transition("activate", self._activate)
        if outcome is TransitionCallbackReturn.SUCCESS:
            self._end_starting()
        return outcome

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Stop it; it stays open."""
        return self._transition("deactivate", self._deactivate)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Close it."""
        return self._transition("clean up", self._release)

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and close it from any state."""
        self._end_starting()
        return self._transition("shut down", self._release)

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured, so that the node can be configured again."""
        self._transition("release the device", self._release)
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, verb: str, act: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            act()
        except DriverError as error:
            self._report_once(f"cannot {verb}: {error}")
            self._may_retry = error.retry
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001  # rclpy drops exceptions of transitions without a message
            self._report_once(f"cannot {verb}: {type(error).__name__}: {error}")
            self._may_retry = False
            return TransitionCallbackReturn.ERROR
        self._last_error = ""
        return TransitionCallbackReturn.SUCCESS

    def _LifecycleNodeMixin__on_change_state(  # noqa: N802  # the name of rclpy's callback
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Refuse an impossible request from anywhere in the ROS domain; rclpy's exception would end the node."""
        asked = request.transition.label or f"number {request.transition.id}"
        try:
            answer = super()._LifecycleNodeMixin__on_change_state(request, response)
        except rclpy_implementation.RCLError:
            state = self._state_machine.current_state[1]
            self.get_logger().warning(f"transition {asked} refused: impossible in the state {state}")
            response.success = False
            return response
        if answer.success:
            self.get_logger().info(f"transition {asked} on request: now {self._state_machine.current_state[1]}")
        return answer

    def _report_once(self, text: str) -> None:
        if text != self._last_error:
            self._report(text)
        self._last_error = text

    def _end_starting(self) -> None:
        if self._starter is not None:
            self.destroy_timer(self._starter)
            self._starter = None

    def destroy_node(self) -> None:
        """Release the device, then end the node."""
        self._transition("release the device", self._release)
        self.leave_graph()

    def leave_graph(self) -> None:
        """End the node itself; rclpy keeps the state machine, and with it the node's name in the graph."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()
