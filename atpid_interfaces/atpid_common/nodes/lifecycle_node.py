# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node that outlives an impossible request."""

from __future__ import annotations

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode


class EnduringLifecycleNode(LifecycleNode):
    """Refuses a transition that is impossible in its state, `configure` while it is active say.

    rclpy's own lets the exception through, which ends the node: anybody in the ROS domain could stop a motor or an
    acquisition in mid-run by a wrong request.
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
