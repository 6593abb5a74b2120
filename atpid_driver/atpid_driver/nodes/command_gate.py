# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which commands may move something: those of the sender that is followed, in time, and made since it was armed.

A drive has its permit while its node is active. Every stop takes it away, and only arming gives it back. A command is a
decision, however often it is repeated, and one that was made before the drive was armed is void for good.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.latency import Latencies
from atpid_driver.motor.errors import CommandStaleError
from atpid_driver.motor.freshness import Freshness
from atpid_driver.nodes.authority import Commander
from atpid_driver.settings import SupervisedSettings

#: So many decisions that are void are known; each goes on being repeated, or is forgotten first.
_MOST_VOIDED = 64


class _Seen(NamedTuple):
    """When a decision came last, steady [s], as which message of its publisher; 0: that is not known."""

    at: float
    number: int


def number_of(info: dict[str, int]) -> int:
    """Return the publisher's own count of its messages; 0: the middleware has none."""
    return info.get("publication_sequence_number") or 0


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
        foreign = bool(self._commander.judge(number_of(info)))
        seen = _Seen(time.monotonic(), number_of(info))
        if foreign and self._last is not None and decision == self._last[0]:
            self._last = decision, seen
        if foreign and (self._commander.several or decision in self._voided):
            self._remember(decision, seen)
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

        decision: what is commanded, equal for commands that repeat one decision. One that was voided may be made anew
        by a program that has been started since, after it has not come for `stale_timeout`.
        """
        self.latencies.add(info.get("received_timestamp", 0) - stamp)
        self._late = self._freshness.age(stamp, time.monotonic_ns())
        seen, before = _Seen(time.monotonic(), number_of(info)), self._voided.get(decision)
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

    def status(self) -> DiagnosticStatus:
        """Return the status "NODE: commands"."""
        return self._commander.status()
