# SPDX-License-Identifier: Apache-2.0
"""The end of a source: everything published is delivered, the recorder closes its bag, then the node is done."""

from collections.abc import Callable, Iterable

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future

PERIOD = 0.05  # between two checks whether the bag is closed [s]
DELIVERY = 1.0  # how long a subscriber may take to receive the last messages [s]


class Leaving:
    """Sets `done`, the node's exit status, once."""

    def __init__(self, node: Node, publishers: Callable[[], Iterable[Publisher]], held: Callable[[], bool]) -> None:
        """Do nothing yet. `held`: whether the recorder still writes what was published."""
        self._node, self._publishers, self._held = node, publishers, held
        self.done: Future = Future()
        self.status: int | None = None  # None: the run goes on

    def when_recorded(self, status: int) -> None:
        """Leave with `status` as soon as the recorder has closed its bag."""
        self.status = status
        self._timer = self._node.create_timer(PERIOD, self._check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def at_once(self, status: int) -> None:
        """Leave with `status` as soon as everything published is delivered."""
        self.status = status
        for publisher in self._publishers():
            publisher.wait_for_all_acked(Duration(seconds=DELIVERY))
        if not self.done.done():
            self.done.set_result(status)

    def _check(self) -> None:
        if not self._held() and self.status is not None:
            self._timer.cancel()
            self.at_once(self.status)
