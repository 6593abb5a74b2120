# SPDX-License-Identifier: Apache-2.0
"""Another motor node of this name in the graph: two must not move one ceiling, on whatever machines they run."""

from __future__ import annotations

import time
from dataclasses import dataclass

from atpid_interfaces.msg import Event
from rclpy.node import Node

from atpid_common.nodes.single_instance import duplicates

#: Discovery takes this long at most: a node of this name seen within it was there before [s].
DISCOVERY_TIME = 3.0


@dataclass(frozen=True)
class Duplicate:
    """A duplicate that has appeared; ALARM: it was there before, so this node must not move the ceiling."""

    severity: int
    text: str


class DuplicateNodes:
    """Decides which of two nodes of one name may move the ceiling.

    The one that was there before goes on; one that is started later is inhibited, so of two that start together
    neither moves. One that was killed stays in the graph for some seconds: once it is gone the other may move.
    """

    def __init__(self, node: Node) -> None:
        """Begin inhibited as soon as a duplicate is found."""
        self._node = node
        self.started = time.monotonic()
        self.inhibits_motion = self._present = False

    def check(self) -> Duplicate | None:
        """Check the graph, once a second; return a duplicate that has appeared since, once."""
        before, self._present = self._present, duplicates(self._node) > 0
        starting = time.monotonic() - self.started < DISCOVERY_TIME
        self.inhibits_motion = self._present and (starting or self.inhibits_motion)
        if before or not self._present:
            return None
        name = self._node.get_fully_qualified_name()
        if starting:
            return Duplicate(Event.ALARM, f"{name} is already running in this ROS graph: motor off until it is gone")
        return Duplicate(Event.WARNING, f"another {name} was started in this ROS graph; this one stays")
