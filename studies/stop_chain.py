# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each way to stop the ceiling in motion, over the real firmware and the whole emulated stand, by the board's clock.

`python -m studies stop-chain --page docs/stand.md` takes five minutes and puts the table into that page.
"""

import argparse
import math
import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import Event
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from std_srvs.srv import Trigger

from atpid_common.arguments import file_path, real, text, whole
from atpid_common.errors import DONE, NUMERICAL_FAILURE, InputError
from studies.watched_stand import COLD, HOT, Answer, WatchedStand, watched_stand

#: Arguments of the example in the help.
EXAMPLE = "--only keyboard"
#: Motor off within [s]: where a process that is there acts at once, and where a silence has to be noticed first.
AT_ONCE, AFTER_SILENCE = 0.2, 0.5
#: A stand is watched for so long after a stop; at most, until it has been answered and the motor is off; until a run
#: has ended [s].
WATCHED, LONGEST, ENDING = 0.7, 3.0, 60.0
#: Samples wait for the end of their block, which is the limit of what a level's stop counts from [s].
BLOCK = 0.05
#: Lines of a page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies {} -->", "<!-- end -->"

Act = Callable[[WatchedStand], Callable[[], Answer | None]]
Undo = Callable[[WatchedStand], object]


@dataclass(frozen=True)
class Way:
    """A way to stop: what is done, by when the motor has to be off [s], and how the stand goes on."""

    name: str
    act: Act
    allowed: float = AT_ONCE
    undo: Undo = lambda _stand: None
    ends: bool = False  # the run ends with it
    stops: bool = True  # False: the run does not need what fails, and goes on


@dataclass(frozen=True)
class Seen:
    """What became of one stop: times since the event [s], NaN: never; further travel [m]."""

    off: float
    travel: float
    answer: str
    problems: tuple[str, ...]


@dataclass
class Row:
    """All that was seen of one way, without and with late answers."""

    way: Way
    seen: dict[bool, list[Seen]] = field(default_factory=lambda: {False: [], True: []})


def service(kind: Any, name: str, request: Any) -> Act:
    """Call a service."""
    return lambda stand: stand.call(kind, name, request)


def transition(node: str, number: int) -> Act:
    """Ask a node for a transition of its lifecycle."""
    return service(ChangeState, f"{node}/change_state", ChangeState.Request(transition=Transition(id=number)))


def _typed(key: str) -> Act:
    """Type a key at the stand's terminal; the answer is what it prints, or its exit status."""

    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        begin = len(stand.terminal.printed)
        stand.terminal.type(key)
        return lambda: _printed(stand, begin)

    return act


def _printed(stand: WatchedStand, begin: int) -> Answer | None:
    if (status := stand.terminal.poll()) is not None:
        return status == 130, f"exit status {status}"
    lines = [line.strip() for line in stand.terminal.printed[begin:].splitlines() if "motor off" in line]
    return ("not confirmed" not in lines[0], lines[0]) if lines else None


def _sent(node: str, number: signal.Signals, *, ends: bool = False) -> Act:
    """Send a signal; there is no answer, but the run's end is printed, or an alarm published."""

    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        begin, published = len(stand.terminal.printed), len(stand.watch.events)
        os.kill(stand.node(node), number)
        return lambda: _ended(stand, begin) if ends else _reported(stand, published)

    return act


def _ended(stand: WatchedStand, begin: int) -> Answer | None:
    """Return the error with which a run has ended, without what its log adds, or the status."""
    if (status := stand.terminal.poll()) is None:
        return None
    lines = [line for line in stand.terminal.printed[begin:].splitlines() if line.startswith("error: ")]
    return True, re.split(r" / | \(whole log", lines[0])[0] if lines else f"exit status {status}"


def _reported(stand: WatchedStand, published: int) -> Answer | None:
    """Return the first alarm since then, without folders."""
    texts = [event.text for event in stand.watch.events[published:] if event.severity >= Event.WARNING]
    return (True, f"event: {re.sub(r'/[^ ]*/', '', texts[0])}") if texts else None


def _goes_on(node: str) -> Undo:
    return lambda stand: os.kill(stand.node(node), signal.SIGCONT)


def _hot(stand: WatchedStand) -> Callable[[], Answer | None]:
    """Pass an abort level: the first sample is a block older than the message."""
    published = len(stand.watch.events)
    end = time.monotonic() + BLOCK
    while time.monotonic() < end:
        stand.spin()
    stand.watch.measure_temperature(HOT)
    return lambda: _reported(stand, published)


def _unplug(stand: WatchedStand) -> Callable[[], Answer | None]:
    published = len(stand.watch.events)
    stand.board.do("unplug")
    return lambda: _reported(stand, published)


def _silent(stand: WatchedStand) -> Callable[[], Answer | None]:
    """Take the samples away, with which estimates and commands end: all processes live, and answer."""
    published = len(stand.watch.events)
    transition("labjack_node", Transition.TRANSITION_DEACTIVATE)(stand)
    return lambda: _reported(stand, published)


def killed(node: str, allowed: float = AT_ONCE) -> Way:
    """Return the way of a node that is killed, with which the run ends."""
    return Way(f"{node} killed", _sent(node, signal.SIGKILL, ends=True), allowed, ends=True)


def hung(node: str, *, stops: bool = True) -> Way:
    """Return the way of a node that hangs for a while."""
    return Way(f"{node} hung", _sent(node, signal.SIGSTOP), AFTER_SILENCE, _goes_on(node), stops=stops)


_TRIGGER = Trigger.Request()
#: In the order in which they are tried: those after which the run goes on share a stand, to which Ctrl-C is the last.
WAYS = (
    Way("live page: Stop", lambda stand: stand.page.ask(do="stop")),
    Way("service `supervisor_node/stop`", service(Trigger, "supervisor_node/stop", _TRIGGER)),
    Way("service `motor_node/stop`", service(Trigger, "motor_node/stop", _TRIGGER)),
    Way("lifecycle `deactivate`", transition("motor_node", Transition.TRANSITION_DEACTIVATE)),
    Way("Enter at the terminal", _typed("\n")),
    Way("abort level passed, from the first sample on", _hot, undo=lambda stand: stand.watch.measure_temperature(COLD)),
    Way(
        "live page: Hold (a command without a height)",
        lambda stand: stand.page.ask(do="hold", on=True),
        undo=lambda stand: stand.page.ask(do="hold", on=False),
    ),
    Way("silence of commands", _silent, AFTER_SILENCE, transition("labjack_node", Transition.TRANSITION_ACTIVATE)),
    Way("cable pulled", _unplug, AFTER_SILENCE, lambda stand: stand.board.do("plug")),
    *(hung(f"{name}_node") for name in ("motor", "supervisor", "identifier", "selector", "recorder", "labjack")),
    hung("live_node", stops=False),
    Way("live_node killed", _sent("live_node", signal.SIGKILL), stops=False),
    Way("Ctrl-C at the terminal", _typed("\x03"), ends=True),
    Way("SIGTERM of the stand's process", _sent("stand", signal.SIGTERM, ends=True), ends=True),
    Way("the stand's process killed", _sent("stand", signal.SIGKILL, ends=True), ends=True),
    killed("motor_node", AFTER_SILENCE),
    *(killed(f"{name}_node") for name in ("supervisor", "identifier", "selector", "recorder", "labjack")),
)


def tried(way: Way, stand: WatchedStand) -> Seen:
    """Try a way while the ceiling is in the middle of a travel, and watch what becomes of it."""
    begun, since, published = stand.move(), time.monotonic(), len(stand.watch.events)
    answered, answer, problems = way.act(stand), None, []
    while (elapsed := time.monotonic() - since) < (ENDING if way.ends else LONGEST):
        stand.spin()
        if (
            answer is None
            and (answer := answered()) is not None
            and "motor off" in answer[1]
            and stand.board.state().motor
        ):
            problems.append(f"the motor was on when this was answered: {answer[1]}")
        now = stand.board.state()
        if elapsed > WATCHED and (not way.stops or (answer is not None and not now.motor)):
            break
    if not way.stops:
        return Seen(math.nan, math.nan, "the run goes on", tuple(_stops(stand.watch.events[published:])))
    off = math.nan if now.motor else (now.motor_off_ms - begun.ms) * 1e-3
    if answer is None or not answer[0]:
        problems.append(f"not confirmed: {answer[1]}" if answer else f"no answer within {elapsed:.1f} s")
    if not off <= way.allowed:
        problems.append(f"motor off after {off:.3f} s, allowed {way.allowed:g} s")
    travel = (now.travel_um - begun.travel_um) * 1e-6
    return Seen(off, travel, answer[1] or "success" if answer else "none", tuple(problems))


def _stops(events: Sequence[Event]) -> list[str]:
    return [f"it stopped: {event.text}" for event in events if event.kind in (Event.STOPPED, Event.FAULT)]


def measured(ways: Sequence[Way], repeats: int, late: float) -> Iterator[tuple[Way, Seen]]:
    """Yield what was seen of each way, with answers of the board that are `late` [s]."""
    with ExitStack() as stack:
        stand: WatchedStand | None = None
        for way in ways:
            for _ in range(repeats):
                stand = stand or stack.enter_context(watched_stand(late))
                yield way, tried(way, stand)
                if way.ends:
                    stack.close()
                    stand = None
                else:
                    way.undo(stand)


def table(rows: Sequence[Row]) -> str:
    """Return the worst of each way as a Markdown table."""
    lines = ["| way | motor off after | further travel | allowed |", "|---|---|---|---|"]
    for row in rows:
        if row.way.stops:
            every = [one for seen in row.seen.values() for one in seen]
            worst = [_worst([one.off for one in every], "ms"), _worst([one.travel for one in every], "mm")]
            cells = [*worst, f"{1e3 * row.way.allowed:g} ms"]
        else:
            cells = ["–"] * 3
        lines.append(f"| {' | '.join([row.way.name, *cells])} |")
    return "\n".join(lines)


def _worst(values: Sequence[float], unit: str) -> str:
    """Return the largest of some values in s or m; NaN: a motor that stays on."""
    if not values:
        return ""
    return "never" if any(map(math.isnan, values)) else f"{1e3 * max(values):.0f} {unit}"


def into(page: Path, made: str, study: str = "stop-chain") -> None:
    """Put the table of a study between its two lines of a page."""
    begin = _BEGIN.format(study)
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    if _END not in rest:
        raise InputError(f"--page {page}: has no lines {begin} and {_END}, between which the table goes")
    page.write_text(f"{before}{begin}\n{made}\n{_END}{rest.partition(_END)[2]}", encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of this study."""
    late = "how late the board's answers are in the second half, 0: there is none; default: %(default)s s"
    parser.add_argument("--late", type=real(0.0, 0.2, "s"), default=0.016, metavar="SECONDS", help=late)
    parser.add_argument("--only", type=text, default="", metavar="WORDS", help="ways whose name has these words")
    parser.add_argument("--page", type=file_path, metavar="FILE.md", help="page whose table is made anew")
    parser.add_argument("--repeats", type=whole(1, 1000), default=1, metavar="N", help="the table has the worst of N")


def run(arguments: argparse.Namespace) -> int:
    """Print the table, and each stop that broke a rule; return 3 where one did."""
    ways = [way for way in WAYS if arguments.only in way.name]
    if not ways:
        raise InputError(f"--only: given {arguments.only!r}; allowed: words of {', '.join(way.name for way in WAYS)}")
    rows, broken = {way.name: Row(way) for way in ways}, 0
    for late in (0.0, arguments.late) if arguments.late else (0.0,):
        for way, seen in measured(ways, arguments.repeats, late):
            rows[way.name].seen[late > 0.0].append(seen)
            broken += bool(seen.problems)
            print(f"{way.name}, answers {1e3 * late:g} ms late: {_line(seen)}", flush=True)
    made = table(list(rows.values()))
    print(made)
    print(f"{sum(len(seen) for row in rows.values() for seen in row.seen.values())} stops, {broken} that broke a rule")
    if arguments.page:
        into(arguments.page, made)
    return NUMERICAL_FAILURE if broken else DONE


def _line(seen: Seen) -> str:
    return f"{_worst([seen.off], 'ms')}, {_worst([seen.travel], 'mm')}, {'; '.join([seen.answer, *seen.problems])}"
