# SPDX-License-Identifier: Apache-2.0
"""The height of the simulated plant's ceiling, at which a simulated motor starts, as a position sensor would measure.

A motor node that is started in mid-run must not move the plant's ceiling by assuming a height.
"""

from collections.abc import Callable

from atpid_interfaces.msg import PlantTruth
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription

from atpid_common.nodes.checked import subscribe

ANNOUNCE_AFTER = 3.0  # until the wait is logged: discovery takes up to so long [s]


class PlantCeiling:
    """Calls `place` once with the height [m] of the plant's ceiling, from the plant's handshake or its last block."""

    def __init__(self, node: Node, place: Callable[[float], None]) -> None:
        """Subscribe to plant/truth until the height is known."""
        self._node, self._place = node, place
        # without event handlers, which the lockstep bench takes out of its executor: it could not be destroyed then
        bare = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._truth: Subscription | None = subscribe(
            node, PlantTruth, "plant/truth", self._on_truth, 1, event_callbacks=bare
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(ANNOUNCE_AFTER, self._announce, clock=steady)

    def _on_truth(self, truth: PlantTruth) -> None:
        if self._truth is None or not len(truth.ceiling):
            return
        self._timer.cancel()
        self._node.destroy_subscription(self._truth)
        self._truth = None
        self._place(truth.ceiling[-1])

    def _announce(self) -> None:
        self._timer.cancel()
        self._node.get_logger().warning(
            "initial_height is NaN: waiting for plant/truth, which holds where the simulated ceiling stands; set "
            "initial_height [m] where there is no plant"
        )
