# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who may move ceiling or exciter: the publisher whose commands are followed, as long as the supervisor permits
motion, and of two nodes of one name the one that was there before."""

import time
from collections.abc import Callable

from atpid_interfaces.msg import Event, SupervisorState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.single_instance import is_alone

#: What the middleware calls a node before it has its name; a program without a ROS node never gets another one.
UNKNOWN = "_NODE_NAME_UNKNOWN_"
#: How long a publisher may be without a name before it is reported as one [s].
NAMING_TIME = 1.0
#: After so long without a command that must not be followed the next one is reported again [s].
REPORT_AGAIN = 1.0
#: A publisher's own count of its messages may jump by so many: some were lost.
MOST_LOST = 1000
#: Where the supervisor publishes its permission.
TOPIC = "supervisor/state"
#: Discovery takes this long at most: a node of this name seen within it was there before [s].
DISCOVERY_TIME = 3.0


class Commander:
    """Judges the commands of a topic by who publishes there.

    A message does not carry its sender, so while the graph shows two senders of different names no command is
    followed. Two of one name are one that was started again, whose former self stays in the graph for some seconds,
    unless both send: then the one that was there before is followed, by its own count of its messages.
    """

    def __init__(self, node: Node, topic: str, name: str, silence: float) -> None:
        """Judge commands to `node`.

        name: the only node that may command, empty: any; silence: after which a publisher has left [s].
        """
        self._node, self._name, self._silence = node, name, silence
        self.topic, self._resolved = topic, node.resolve_topic_name(topic)
        self._number, self._followed_at = 0, -silence  # of the last command followed
        self._began = self._last = -REPORT_AGAIN  # of commands that must not be followed [s]
        self._reported = False
        self.several = False  # the graph shows another sender than the one that may command
        self.problem = ""  # why the last command must not be followed; empty: it may
        self.refused = 0

    def judge(self, number: int) -> str:
        """Return why a command, its publisher's message `number` (0: unknown), must not be followed; empty: it may."""
        problem = self._of_graph()
        self.several = bool(problem)
        self.problem = problem or self._of_sequence(number)
        if self.problem:
            now = time.monotonic()
            if now - self._last > REPORT_AGAIN:
                self._began, self._reported = now, False
            self._last = now
            self.refused += 1
        return self.problem

    def to_report(self) -> bool:
        """Return whether the problem is to be reported now: once, and not while a name is about to be known."""
        named = UNKNOWN not in self.problem or self._last - self._began > NAMING_TIME
        reported, self._reported = self._reported, self._reported or named
        return named and not reported

    def _of_graph(self) -> str:
        """Return what is wrong with the publishers there are."""
        if not self._name and self._node.count_publishers(self._resolved) < 2:
            return ""
        found = self._node.get_publishers_info_by_topic(self._resolved)
        names = sorted({f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in found})
        if len(names) > 1:
            return f"{self.topic} is published by {' and '.join(names)}; none is followed until there is one"
        wanted = f"{self._node.get_namespace().rstrip('/')}/{self._name}"
        if self._name and names and names[0] != wanted:
            return f"{self.topic} is published by {names[0]}; allowed: {wanted} (parameter commander)"
        return ""

    def _of_sequence(self, number: int) -> str:
        """Return what is wrong with a message whose publisher has numbered it so; 0: by no count."""
        now = time.monotonic()
        in_turn = self._number < number <= self._number + MOST_LOST
        if number and not in_turn and now - self._followed_at <= self._silence:
            return f"{self.topic} is published by two nodes of one name; the one that was there before is followed"
        self._number, self._followed_at = number, now
        return ""

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: commands"."""
        problem = self._of_graph() or self.problem
        level = DiagnosticStatus.ERROR if problem else DiagnosticStatus.OK
        return status(self._node, "commands", level, problem or "of one publisher", {"not followed": self.refused})


class MotionPermit:
    """Whether motor or exciter may move now; always, where it is not supervised."""

    def __init__(
        self, node: Node, on_stop: Callable[[str], None], timeout: float, on_state: Callable[[], None] = lambda: None,
        *, supervised: bool,
    ) -> None:  # fmt: skip
        """Subscribe where it is supervised; on_stop: called with the reason of a stop, by each message that has one.

        timeout: silence of the supervisor that withdraws the permission [s]; on_state: called after each message.
        """
        self._on_state = on_state
        self.supervised, self._timeout, self._on_stop = supervised, timeout, on_stop
        self._permitted, self._received = False, 0.0  # steady [s]
        self.ending = False  # the supervisor ends in order
        self._reason = "no supervisor has been found yet"
        if supervised:
            # the newest alone: a node that was held up must not move by a permission that has been withdrawn since
            subscribe(node, SupervisorState, TOPIC, self._receive, QoSProfile(depth=1))

    @property
    def granted(self) -> bool:
        """Whether the motor may move, and its heartbeat go on."""
        return not self.supervised or (self._permitted and not self._silent)

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
        self._on_state()


class DuplicateNodes:
    """Decides which of two nodes of one name may move ceiling or exciter.

    The one that was there before goes on; one that is started later is inhibited, so of two that start together
    neither moves. One that was killed stays in the graph for some seconds: once it is gone the other may move.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.started = time.monotonic()
        self.inhibits_motion = self._present = False

    def check(self) -> tuple[int, str] | None:
        """Check the graph, once a second; return severity and text of a duplicate that has appeared since, once.

        ALARM: it was there before, so this node must not move anything.
        """
        before, self._present = self._present, not is_alone(self._node)
        starting = time.monotonic() - self.started < DISCOVERY_TIME
        self.inhibits_motion = self._present and (starting or self.inhibits_motion)
        if before or not self._present:
            return None
        name = self._node.get_fully_qualified_name()
        if starting:
            return Event.ALARM, f"{name} is already running in this ROS graph: off until it is gone"
        return Event.WARNING, f"another {name} was started in this ROS graph; this one stays"
