# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which commands may move something: those of the sender that is followed, in time, and made since it was armed.

A drive has its permit while its node is active. Every stop takes it away, and only arming gives it back. A command is a
decision, however often it is repeated, and one that was made before the drive was armed is void for good.
"""

import time
from collections import deque
from collections.abc import Callable

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.latency import Latencies
from atpid_driver.motor.errors import CommandStaleError
from atpid_driver.motor.freshness import Freshness
from atpid_driver.nodes.authority import Commander
from atpid_driver.settings import SupervisedSettings


class CommandGate:
    """Judges each command by its sender and its age, and reports what is refused once.

    The age of a command is the largest of three: by its stamp and the steady clock (`Freshness`), since its
    publication, and since its receipt. A command that waits in the link after that is judged there (`Link`).
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
        self._commander = Commander(node, topic, settings.commander, settings.stale_timeout)
        self._freshness = Freshness()
        self._late = 0.0  # of the last command [s]
        self._decision: object = None  # of the last command
        self._void = False  # it was made before the drive was armed, or its motion has been ended since
        self._number = 0  # of the last message of its publisher
        self._beside = deque[object](maxlen=64)  # decisions that were repeated beside another sender
        self._armed = False  # ever
        self._last_refused: object = None
        self.latencies = Latencies()  # from a sample to the receipt of the command that answers it

    def is_foreign(self, info: dict[str, int], decision: object) -> bool:
        """Return whether it is not certain that the sender may command.

        To be asked first: a foreign command must leave no trace, such as its stamp.
        """
        if self._settings.lockstep:
            return False
        foreign = bool(self._commander.judge(info.get("publication_sequence_number") or 0))
        if foreign and self._commander.several:
            self._beside.append(decision)
        return foreign

    @property
    def several_senders(self) -> bool:
        """Whether the graph shows another sender than the one that may command: then nothing may move."""
        return self._commander.several

    def report_foreign(self, value: float) -> None:
        """Report a foreign command of `value`, once."""
        if self._commander.to_report():
            text = f"command ignored: {self._commander.problem}"
            self._publish_event(Event.ALARM, Event.REFUSED, value, text)

    def receive(self, stamp: int, info: dict[str, int], decision: object) -> None:
        """Take the `stamp` [ns] of a command that is to be followed, and the middleware's `info` about it.

        decision: what is commanded, equal for commands that repeat one decision; another publisher makes a new one.
        """
        self.latencies.add(info.get("received_timestamp", 0) - stamp)
        self._late = self._freshness.age(stamp, time.monotonic_ns())
        before, self._number = self._number, info.get("publication_sequence_number") or 0
        if decision != self._decision or 0 < self._number <= before:
            self._decision, self._void = decision, decision in self._beside
        self._beside.clear()

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
            self._void = True
            raise CommandStaleError(f"command ignored: it was made {waited:.2f} s ago, before it was armed")
        if self._void:
            raise CommandStaleError(
                "command ignored: it is older than the last stop, however often it is repeated; give a new one, with "
                "another sequence"
            )

    def void(self) -> None:
        """Ignore repetitions of the last command: what it moved has been ended."""
        self._void = True

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
        self._void = self._armed or self._settings.supervised
        self._armed = True

    def restart(self) -> None:
        """A source begins: its stamps are not those of the one before."""
        self._freshness.restart()

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: commands"."""
        return self._commander.status()
