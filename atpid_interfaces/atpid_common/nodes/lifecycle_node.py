# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node that refuses an impossible transition."""

from __future__ import annotations

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode


class CheckedLifecycleNode(LifecycleNode):
    """Refuses a transition that is impossible in its state, such as `configure` while it is active.

    rclpy's own does not catch the exception, which ends the node: a wrong request from anywhere in the ROS domain
    would stop a motor or an acquisition in mid-run.
    """

    def _LifecycleNodeMixin__on_change_state(  # noqa: N802  # the name of rclpy's callback
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)
        except rclpy_implementation.RCLError:
            asked = request.transition.label or f"number {request.transition.id}"
            state = self._state_machine.current_state[1]
            self.get_logger().warning(f"transition {asked} refused: impossible in the state {state}")
            response.success = False
            return response
