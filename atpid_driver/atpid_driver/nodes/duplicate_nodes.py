# SPDX-License-Identifier: Apache-2.0
"""Another motor node of this name in the graph: two must not move one ceiling, on whatever machines they run."""

import time

from atpid_interfaces.msg import Event
from rclpy.node import Node

from atpid_common.nodes.single_instance import is_alone

#: Discovery takes this long at most: a node of this name seen within it was there before [s].
DISCOVERY_TIME = 3.0


class DuplicateNodes:
    """Decides which of two nodes of one name may move the ceiling.

    The one that was there before goes on; one that is started later is inhibited, so of two that start together
    neither moves. One that was killed stays in the graph for some seconds: once it is gone the other may move.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.started = time.monotonic()
        self.inhibits_motion = self._present = False

    def check(self) -> tuple[int, str] | None:
        """Check the graph, once a second; return severity and text of a duplicate that has appeared since, once.

        ALARM: it was there before, so this node must not move the ceiling.
        """
        before, self._present = self._present, not is_alone(self._node)
        starting = time.monotonic() - self.started < DISCOVERY_TIME
        self.inhibits_motion = self._present and (starting or self.inhibits_motion)
        if before or not self._present:
            return None
        name = self._node.get_fully_qualified_name()
        if starting:
            return Event.ALARM, f"{name} is already running in this ROS graph: motor off until it is gone"
        return Event.WARNING, f"another {name} was started in this ROS graph; this one stays"
