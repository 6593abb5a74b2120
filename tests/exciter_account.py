# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""When there must be no output, by what was done to the nodes alone; it shares no code with them.

A *ban* says that nothing may be put out from some instant on. One that is latched is lifted by an arm that was asked
for after its cause began, and a command decided after that was asked for; another by a command decided after its cause.
Only what is certain becomes a ban: where it is not known which of two things came first there is none. Times are
steady [s].
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from atpid_interfaces.msg import ExcitationCommand
from exciter_graph import (
    ANSWER_TIME,
    BAND,
    BLIND,
    HIGHEST,
    SATURATION,
    STALE,
    SUPERVISION,
    TOLERANCE,
    Estimate,
    Record,
    Stretch,
)

EXCITER, MOTOR = "excitation_node", "motor_node"
SUPERVISOR, IDENTIFIER = "supervisor_node", "identifier_node"
#: Until the output is off after a stop, where something hangs, and where only the device's watchdog is left: twice what
#: is promised for the first two, since milliseconds are measured elsewhere [s].
STOPPED, HUNG, UNREACHABLE = 0.4, 0.9, 3.6
#: A node that hangs for so long has been noticed for certain [s].
NOTICED = {
    EXCITER: 0.25 + 0.2, SUPERVISOR: SUPERVISION + 0.2, IDENTIFIER: ANSWER_TIME + 0.3, MOTOR: ANSWER_TIME + 0.3,
}  # fmt: skip
#: A rule about something that lasts is not judged before it has lasted so much longer [s].
CLEAR = 0.5


@dataclass
class Decision:
    """A command, and when it was published."""

    message: ExcitationCommand
    first: float
    refused: bool
    sent: list[float] = field(default_factory=list)

    @property
    def moves(self) -> bool:
        """Whether it may be followed, and moves something."""
        return self.message.kind != ExcitationCommand.OFF and not self.refused


@dataclass
class Arm:
    """A request to arm the exciter: when, and whether it has been refused, None: no answer yet."""

    at: float
    refused: bool | None = None


@dataclass
class Ban:
    """No output from `since` + `allowed` on."""

    why: str
    since: float
    allowed: float
    nodes: tuple[str, ...] = (EXCITER,)  # that have to do something about it
    latched: bool = True
    until: float = math.inf  # it ends by itself
    confirmed: float = math.inf  # when somebody was told that the output is off


@dataclass
class Hang:
    """A node that began to hang while something was commanded."""

    name: str
    begin: float


def refused(command: ExcitationCommand) -> bool:
    """Return whether a command is outside the limits for certain."""
    low, high = BAND
    if command.kind == ExcitationCommand.OFF:
        return False
    if not 0.0 <= command.amplitude <= HIGHEST * 1.001 or not low * 0.999 <= command.frequency <= high * 1.001:
        return True
    if command.kind == ExcitationCommand.SINE:
        return False
    if not low * 0.999 <= command.end_frequency <= high * 1.001:
        return True
    return bool(command.hold and command.kind == ExcitationCommand.RANDOM)


class Account:
    """What was done, in order, and what follows from it."""

    def __init__(self, record: Record, unresponsive: Callable[[Sequence[str]], list[Stretch]]) -> None:
        """Begin with nothing done; unresponsive: returns when any of these nodes did not spin."""
        self._record, self._of_nodes = record, unresponsive
        self.arms: list[Arm] = []
        self.decisions: list[Decision] = []
        self.bans: list[Ban] = []
        self.hangs: list[Hang] = []
        self.others: list[Stretch] = []  # when another one could command, too
        self.disturbed: list[Stretch] = []  # when process of the output or device could not do what they were asked for
        self._silences = 0  # of the commander that are judged

    def ban(self, why: str, since: float, allowed: float, *nodes: str, **more: Any) -> Ban:
        """Add a ban."""
        self.bans.append(Ban(why, since, allowed, (EXCITER, *nodes), **more))
        return self.bans[-1]

    def arm(self, at: float) -> Arm:
        """Note that somebody asks to arm the exciter."""
        self.arms.append(Arm(at))
        return self.arms[-1]

    @property
    def decision(self) -> Decision | None:
        """The last one."""
        return self.decisions[-1] if self.decisions else None

    def lifted(self, ban: Ban) -> float:
        """Return when something may be put out again; infinity: it may not yet."""
        since = ban.since
        if ban.latched:
            since = min((one.at for one in self.arms if one.at > since and not one.refused), default=math.inf)
        return min([ban.until, *(one.first for one in self.decisions if one.moves and one.first > since)])

    def due(self, ban: Ban) -> float:
        """Return from when on nothing may be put out: what cannot act has its time afterwards."""
        due = ban.since + ban.allowed
        stretches = sorted([*self._of_nodes(ban.nodes), *self.disturbed], key=lambda one: one.begin)
        for begin, end in stretches:
            if begin < due and end > ban.since:
                due = max(due, end + ban.allowed)
        due += 3.0 * self._record.late(ban.since, due)
        return min(due, ban.confirmed)

    def broken(self, now: float) -> str:
        """Return the first ban that was broken up to `now`, in words; empty: none."""
        for ban in self.bans:
            due, lifted = self.due(ban), self.lifted(ban)
            at = self._record.first(due, min(lifted, now)) if due < min(lifted, now) else math.nan
            if not math.isnan(at):
                return f"output at {at:.3f} s: {ban.why} at {ban.since:.3f} s, off from {due:.3f} s on"
        return ""

    def pending(self, now: float) -> bool:
        """Whether a ban is not due yet."""
        return any(now < self.due(ban) and now < self.lifted(ban) for ban in self.bans)

    def stopped(self) -> bool:
        """Whether any ban holds."""
        return any(math.isinf(self.lifted(ban)) for ban in self.bans)

    def commanded(self, begin: float, end: float) -> bool:
        """Whether the exciter followed a command for certain all the time."""
        before = [one for one in self.decisions if one.first < begin]
        if not before or not self._runs(before[-1], begin):
            return False
        within = [one for one in self.decisions if begin <= one.first <= end]
        if not all(one.moves and one.message.kind != ExcitationCommand.RANDOM for one in within):
            return False
        sent = [at for one in (before[-1], *within) for at in one.sent if begin - 0.4 < at <= end + 0.2]
        gaps = [after - at for at, after in itertools.pairwise(sent)]
        if max(gaps, default=1.0) > 0.5 * STALE or sent[0] > begin - 0.1 or sent[-1] < end - 0.2:
            return False
        return not any(one.begin <= end and one.end >= begin - 0.3 for one in self.others)

    def _runs(self, decision: Decision, at: float) -> bool:
        if not decision.moves or at - decision.first < (
            0.5 if decision.message.kind == ExcitationCommand.RANDOM else 0.2
        ):
            return False
        if any(ban.since <= at and self.lifted(ban) > at for ban in self.bans):
            return False
        return self._record.any(at - 0.06, at)

    def follow(self, now: float, estimates: Sequence[Estimate]) -> None:
        """Add what follows from what has lasted up to `now`."""
        self._follow_hangs(now)
        self._follow_silence(now)
        self._follow_hold(now, estimates)

    def _sure(self, begin: float, end: float) -> float:
        """Return how long something has lasted for everybody, whatever was late [s]."""
        return end - begin - 3.0 * self._record.late(begin, end)

    def _follow_hangs(self, now: float) -> None:
        for hang in list(self.hangs):
            stretch = next((one for one in self._of_nodes([hang.name]) if one.end > hang.begin), None)
            if stretch is None:
                continue
            begin, needed = stretch.begin, NOTICED[hang.name]
            if self._sure(begin, min(now, stretch.end)) > needed:
                self.hangs.remove(hang)
                others = {EXCITER, SUPERVISOR} - {hang.name}
                answered = not any(one.begin < begin + needed and one.end > begin for one in self._of_nodes([*others]))
                if answered and self.commanded(begin, begin + needed):
                    self.bans.append(Ban(f"{hang.name} hung", begin, HUNG, tuple({EXCITER} - {hang.name})))
            elif now > stretch.end:
                self.hangs.remove(hang)

    def _follow_silence(self, now: float) -> None:
        """The commander was silent, or sent only what must not be followed."""
        sent = [(at, one) for one in self.decisions if not one.refused for at in one.sent]
        if not sent:
            return
        for (at, one), (after, _) in zip(
            sent[self._silences :], [*sent[self._silences + 1 :], (now, None)], strict=True
        ):
            if not one.moves:
                continue
            lasted = self._sure(at, after) - sum(
                min(end, after) - max(begin, at)
                for begin, end in self._of_nodes([EXCITER])
                if begin < after and end > at
            )
            if lasted > STALE + CLEAR and not any(ban.since == at and ban.why == "silence" for ban in self.bans):
                self.ban("silence", at, STALE + STOPPED, latched=False)
        self._silences = max(0, len(sent) - 1)

    def _follow_hold(self, now: float, estimates: Sequence[Estimate]) -> None:
        """Nothing usable was identified, or the output was at its limits and missed the command."""
        decision = self.decision
        if (
            decision is None
            or not decision.moves
            or not decision.message.hold
            or not self.commanded(now - 0.3, now - 0.1)
        ):
            return
        command = decision.message
        frequency = min(
            command.frequency, *([command.end_frequency] if command.kind == ExcitationCommand.SWEEP else []), math.inf
        )
        blind = max(BLIND, 5.0 / frequency)
        usable = max((one.at for one in estimates if one.usable), default=0.0)
        begin = max(decision.first + 0.25, usable)
        if self._sure(begin, now) > blind + CLEAR and self.commanded(begin, now - 0.1):
            self.ban(f"nothing usable was identified for {blind:g} s", begin, blind + STOPPED)
        self._follow_saturation(now, decision, estimates)

    def _follow_saturation(self, now: float, decision: Decision, estimates: Sequence[Estimate]) -> None:
        command, begin = decision.message, decision.first + 0.25
        if command.kind != ExcitationCommand.SINE:
            return
        for one in reversed(estimates):
            short = one.amplitude < command.amplitude * (1.0 - 3.0 * TOLERANCE) and one.put[0] > HIGHEST * 0.999
            slow = one.frequency < command.frequency * (1.0 - 3.0 * TOLERANCE) and one.put[1] > BAND[1] * 0.999
            if one.at < begin or not one.usable or not (short or slow):
                begin = max(begin, one.at)
                break
        # the controller's first step comes after the delay of its estimates
        if self._sure(begin, now) > SATURATION + 0.5 + CLEAR and self.commanded(begin, now - 0.1):
            self.ban("the output is at its limits and misses the command", begin, SATURATION + 0.5 + STOPPED)
