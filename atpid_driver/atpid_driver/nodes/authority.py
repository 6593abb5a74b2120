# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who may move ceiling or exciter, and by which commands.

Permitted are the publisher whose commands are followed, as long as the supervisor permits motion, and of two nodes of
one name the one that was there before. Its commands are followed in time, and those made since the drive was armed.
A drive has its permit while its node is active. Every stop takes it away, and only arming gives it back. A command is a
decision, however often it is repeated, and one that was made before the drive was armed is void for good.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

from atpid_interfaces.msg import Event, SupervisorState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile

from atpid_common.latency import Latencies
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.single_instance import is_alone
from atpid_driver.motor.faults import CommandStaleError
from atpid_driver.settings import SupervisedSettings

#: What the middleware calls a node before it has its name; a program without a ROS node never gets another one.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"
#: How long a publisher may be without a name before it is reported as one [s].
_NAMING_TIME = 1.0
#: After so long without a command that must not be followed the next one is reported again [s].
_REPORT_AGAIN = 1.0
#: A publisher's own count of its messages may jump by so many: some were lost.
_MOST_LOST = 1000
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
        self._began = self._last = -_REPORT_AGAIN  # of commands that must not be followed [s]
        self._reported = False
        self.several = False  # the graph shows another sender than the one that may command: then nothing may move
        self.problem = ""  # why the last command must not be followed; empty: it may
        self.refused = 0

    def judge(self, number: int) -> str:
        """Return why a command, its publisher's message `number` (0: unknown), must not be followed; empty: it may."""
        problem = self._of_graph()
        self.several = bool(problem)
        self.problem = problem or self._of_sequence(number)
        if self.problem:
            now = time.monotonic()
            if now - self._last > _REPORT_AGAIN:
                self._began, self._reported = now, False
            self._last = now
            self.refused += 1
        return self.problem

    def to_report(self) -> bool:
        """Return whether the problem is to be reported now: once, and not while a name is about to be known."""
        named = _UNKNOWN not in self.problem or self._last - self._began > _NAMING_TIME
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
        in_turn = self._number < number <= self._number + _MOST_LOST
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

    def __init__(self, node: Node, on_stop: Callable[[str], None], timeout: float, *, supervised: bool) -> None:
        """Subscribe where it is supervised; on_stop: called with the reason of a stop, by each message that has one.

        timeout: silence of the supervisor that withdraws the permission [s].
        """
        self.on_state: Callable[[], None] = lambda: None  # called after each message
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
        self.on_state()


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


#: So many decisions that are void are known; each goes on being repeated, or is forgotten first.
_MOST_VOIDED = 64


class _Seen(NamedTuple):
    """When a decision came last, steady [s], as which message of its publisher; 0: that is not known."""

    at: float
    number: int


def _number_of(info: dict[str, int]) -> int:
    """Return the publisher's own count of its messages; 0: the middleware has none."""
    return info.get("publication_sequence_number") or 0


class CommandGate:
    """Judges each command by its sender and its age, and reports what is refused once.

    The age of a command is the largest of three: by its stamp and the steady clock (`Freshness`), since its
    publication, and since its receipt. A command that waits in the link after that is judged there (`Dialogue`).
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        settings: SupervisedSettings,
        publish_event: Callable[[int, str, float, str], None],
    ) -> None:
        """Begin; publish_event: called with severity, kind, value and text."""
        self._settings, self._publish_event = settings, publish_event
        self.commander = Commander(node, topic, settings.commander, settings.stale_timeout)
        self._freshness = Freshness()
        self._late = 0.0  # of the last command [s]
        self._last: tuple[object, _Seen] | None = None  # the last decision
        self._voided: dict[object, _Seen] = {}  # those that were made before a stop
        self._armed = False  # ever
        self._last_refused: object = None
        self.latencies = Latencies()  # from a sample to the receipt of the command that answers it

    def is_foreign(self, info: dict[str, int], decision: object) -> bool:
        """Return whether it is not certain that the sender may command.

        To be asked first: a foreign command must leave no trace, such as its stamp, but that its decision came.
        """
        if self._settings.lockstep:
            return False
        foreign = bool(self.commander.judge(_number_of(info)))
        seen = _Seen(time.monotonic(), _number_of(info))
        if foreign and self._last is not None and decision == self._last[0]:
            self._last = decision, seen
        if foreign and (self.commander.several or decision in self._voided):
            self._remember(decision, seen)
        return foreign

    def report_foreign(self, value: float) -> None:
        """Report a foreign command of `value`, once."""
        if self.commander.to_report():
            text = f"command ignored: {self.commander.problem}"
            self._publish_event(Event.ALARM, Event.REFUSED, value, text)

    def receive(self, stamp: int, info: dict[str, int], decision: object) -> None:
        """Take the `stamp` [ns] of a command that is to be followed, and the middleware's `info` about it.

        decision: what is commanded, equal for commands that repeat one decision. One that was voided may be made anew
        by a program that has been started since, after it has not come for `stale_timeout`.
        """
        self.latencies.add(info.get("received_timestamp", 0) - stamp)
        self._late = self._freshness.age(stamp, time.monotonic_ns())
        seen, before = _Seen(time.monotonic(), _number_of(info)), self._voided.get(decision)
        self._last = decision, seen
        if before is None:
            return
        if 0 < seen.number <= before.number and seen.at - before.at > self._settings.stale_timeout:
            del self._voided[decision]
        else:
            self._remember(decision, seen)

    def check_fresh(self, info: dict[str, int], now: int) -> None:
        """Raise `CommandStaleError` for a command older than `command_timeout`, or made before the motor was armed.

        The times of its publication and receipt, by the wall clock, are the only ones of a command that comes alone.
        One published while this process was stopped is received afterwards.
        """
        if self._settings.lockstep:
            return
        moments = [info.get(moment, 0) for moment in ("received_timestamp", "source_timestamp")]
        waited = max(self._late, *((time.time_ns() - moment) * 1e-9 if moment > 0 else 0.0 for moment in moments))
        if waited > self._settings.command_timeout:
            raise CommandStaleError(
                f"command ignored: it waited {waited:.2f} s, allowed {self._settings.command_timeout:g} s "
                "(command_timeout)"
            )
        if self._freshness.before_armed(waited, now):
            self.void()
            raise CommandStaleError(f"command ignored: it was made {waited:.2f} s ago, before it was armed")
        if self._last is not None and self._last[0] in self._voided:
            raise CommandStaleError(
                "command ignored: it is older than the last stop, however often it is repeated; give a new one, with "
                "another sequence"
            )

    def void(self) -> None:
        """Ignore repetitions of the last command: what it moved has been ended."""
        if self._last is not None and self._last[0] not in self._voided:
            self._remember(*self._last)

    def _remember(self, decision: object, seen: _Seen) -> None:
        """Keep a decision that is void, and those others that came last."""
        self._voided.pop(decision, None)
        self._voided[decision] = seen
        if len(self._voided) > _MOST_VOIDED:
            del self._voided[next(iter(self._voided))]

    def accepted(self) -> None:
        """Report the next refusal again: a command has been taken up."""
        self._last_refused = None

    def refuse(self, what: object, value: float, error: Exception) -> None:
        """Publish a refusal once for each `what` that is refused: its sender repeats the command."""
        if (type(error), what) == self._last_refused:
            return
        self._last_refused = type(error), what
        self._publish_event(Event.WARNING, Event.REFUSED, value, str(error))

    def armed(self, now: int) -> None:
        """Note that it was armed at `now` [ns]: what was commanded before must not move it."""
        self._freshness.armed(now)
        # one that starts by itself on a bench has been stopped by nobody; on a stand that is not known
        if self._armed or self._settings.supervised:
            self.void()
        self._armed = True

    def restart(self) -> None:
        """A source begins: its stamps are not those of the one before."""
        self._freshness.restart()


#: The least lateness seen is forgotten by so much a second, so that a clock that drifts is followed [-].
_LEAK = 0.01
_NANO = 1e-9


class Freshness:
    """The ages of the commands of one loop, from their stamps. Times are steady, stamps of any clock [ns]."""

    def __init__(self) -> None:
        self._armed = 0
        self._last: tuple[int, int] | None = None  # stamp and receipt of the newest command
        self._least = 0  # receipt minus stamp, where it was least

    def restart(self) -> None:
        """A source begins: its stamps are not those of the one before."""
        self._last = None

    def armed(self, now: int) -> None:
        """Note that the motor was armed at `now`: what was commanded before must not move it."""
        self._armed = now

    def age(self, stamp: int, now: int) -> float:
        """Return by how much a command with `stamp` comes later than the loop's usual delay [s].

        A stamp that is repeated shows nothing, one that goes back begins anew: 0.
        """
        offset = now - stamp
        if self._last is None or stamp < self._last[0]:
            self._last, self._least = (stamp, now), offset
        if stamp > self._last[0]:
            leaked = round(_LEAK * (now - self._last[1]))
            self._least = min(offset, self._least + leaked)
            self._last = stamp, now
            return (offset - self._least) * _NANO
        return 0.0

    def before_armed(self, age: float, now: int) -> bool:
        """Whether a command of this age [s] was made before the motor was armed."""
        return age * 1e9 > now - self._armed
