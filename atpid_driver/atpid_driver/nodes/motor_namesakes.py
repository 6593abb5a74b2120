# SPDX-License-Identifier: Apache-2.0
"""Another motor node of this name in the graph: two must not move one ceiling, on whatever machines they run."""

from __future__ import annotations

import time
from dataclasses import dataclass

from atpid_interfaces.msg import Event
from rclpy.node import Node

from atpid_common.nodes.single_instance import namesakes

#: Discovery takes this long at most: a node of this name seen within it was there before [s].
NEWCOMER = 3.0


@dataclass(frozen=True)
class Found:
    """A namesake that has appeared; ALARM: it was there before, so this node has to stand still."""

    severity: int
    text: str


class Namesakes:
    """Decides which of two nodes of one name stands still.

    The one that was here before goes on; one that comes later stands still itself, so of two that start together
    neither moves. One that was killed stays in the graph for some seconds: once it is gone the other may move.
    """

    def __init__(self, node: Node) -> None:
        """Begin as a newcomer."""
        self._node = node
        self.born = time.monotonic()
        self.stands_still = self._doubled = False

    def look(self) -> Found | None:
        """Look at the graph, once a second; return a namesake that has appeared since, once."""
        before, self._doubled = self._doubled, namesakes(self._node) > 0
        newcomer = time.monotonic() - self.born < NEWCOMER
        self.stands_still = self._doubled and (newcomer or self.stands_still)
        if before or not self._doubled:
            return None
        name = self._node.get_fully_qualified_name()
        if newcomer:
            return Found(Event.ALARM, f"{name} is already running in this ROS graph: motor off until it is gone")
        return Found(Event.WARNING, f"another {name} was started in this ROS graph; this one stays")
