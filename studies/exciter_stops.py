# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each event that has to stop the exciter while it runs, with each of its backends, over the whole emulated stand.

What is put out is seen at the device: as the voltage between the stand-in's outputs, or as the support's motion where
the plant is the exciter. `python -m studies exciter-stops --page docs/excitation_output.md` takes an hour and puts the
table into that page.
"""

import argparse
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from atpid_interfaces.msg import CeilingState, ExcitationState, SampleBlock
from std_srvs.srv import Trigger

from atpid_common.arguments import file_path, text
from atpid_common.errors import DONE, NUMERICAL_FAILURE, InputError
from atpid_common.nodes.messages import BLOCKS, nanoseconds_of
from atpid_control.stand.errors import BenchError
from atpid_driver.standins.outputs import Outputs
from studies.exciter_events import BACKENDS, EVENTS, WATCHDOG, Case, Occurrence, command
from studies.stop_chain import AFTER_SILENCE, into
from studies.watched_stand import WatchedStand, watched_stand

#: Arguments of the example in the help.
EXAMPLE = "--only disarmed --backend labjack_stream"
#: Off within so much [V], [m]; the voltage is looked at that often [s].
OFF_VOLTS, OFF_METRES, LOOK = 5e-3, 1e-3, 5e-4
#: The output has run for so long before an event, and is watched for so long after what is allowed, and after the
#: cause is gone, while the command of before is repeated all the time [s].
RUN, WATCHED, AGAIN = 0.5, 0.5, 0.7
#: A stand may take so long to start, a service to answer, and a person to try again [s].
_START, _ANSWER, _PATIENCE = 240.0, 15.0, 3.0


@dataclass(frozen=True)
class Seen:
    """What became of the output: off, and without any change, after [s]; what is latched, what it took to go on."""

    case: Case
    off: float
    still: float
    latched: str
    go_on: str
    problems: tuple[str, ...] = ()


#: What was seen of an event, by its name, with a backend.
Found = dict[tuple[str, str], list[Seen]]


class Voltage:
    """Looks at the device's output all the time, in a thread of its own."""

    def __init__(self, stand: WatchedStand) -> None:
        """Begin."""
        self._outputs = Outputs(stand.place / "output")
        self.on = self.changed = 0.0  # when there was an output, and when it changed last, steady [s]
        self._ended = False
        self._thread = threading.Thread(target=self._look, name="voltage")
        self._thread.start()

    def _look(self) -> None:
        last = 0.0
        while not self._ended:
            volts, at = self._outputs.between(), time.monotonic()
            if abs(volts) > OFF_VOLTS:
                self.on = at
            if abs(volts - last) > OFF_VOLTS:
                self.changed, last = at, volts
            time.sleep(LOOK)

    def close(self) -> None:
        """End it."""
        self._ended = True
        self._thread.join()


class Support:
    """Follows the true motion of the plant's support, which `simulated` shakes."""

    def __init__(self, stand: WatchedStand) -> None:
        """Begin."""
        self.on = 0.0  # when it moved, steady [s]
        self._clock = stand.watch.get_clock()
        stand.watch.create_subscription(SampleBlock, "emulated/sensors/laser", self._on_block, BLOCKS)

    @property
    def changed(self) -> float:
        """See Voltage."""
        return self.on

    def _on_block(self, block: SampleBlock) -> None:
        moving = np.flatnonzero(np.abs(np.frombuffer(block.data)[:: len(block.channels) or 1]) > OFF_METRES)
        if len(moving):
            age = (self._clock.now().nanoseconds - nanoseconds_of(block.header.stamp)) * 1e-9 - moving[-1] / block.rate
            self.on = max(self.on, time.monotonic() - age)

    def close(self) -> None:
        """End with the stand's watch."""


def _shakes(stand: WatchedStand) -> bool:
    return stand.watch.exciter.mode in (ExcitationState.RAMPING, ExcitationState.RUNNING)


def _runs(stand: WatchedStand, case: Case) -> None:
    """Let it run by a new command: arm motor and exciter where they were stopped."""
    command(stand, hold=case.hold)
    armed, since = time.monotonic(), 0.0

    def runs() -> bool:
        nonlocal armed, since
        now = time.monotonic()
        if not _shakes(stand) and now - armed > 2.0 and stand.ready:
            stand.arm()
            command(stand, hold=case.hold)
            armed = now
        since = (since or now) if stand.watch.exciter.mode == ExcitationState.RUNNING else 0.0
        return bool(since and now - since > RUN)

    stand.until(runs, _START, "the exciter runs")
    case.before(stand)
    stand.remember()


def _spin(stand: WatchedStand, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        stand.spin()


def tried(case: Case, stand: WatchedStand, device: Voltage | Support) -> Seen:
    """Let an event happen while the exciter runs; return what became of its output."""
    _runs(stand, case)
    begun, problems = time.monotonic(), []
    answered = case.act(stand)
    while time.monotonic() - begun < case.allowed + WATCHED:
        stand.spin()
        answered()
    still = device.changed - begun  # by the first look at which it had changed: on a busy machine that may be late
    off = max(device.on - begun, still)
    if case.ends:
        return Seen(case, off, still, "the run ends", "start it, new command")
    if off > case.allowed:
        problems.append(f"the output was on for {off:.3f} s")
    latched = _latched(stand)
    case.undo(stand)
    _spin(stand, AGAIN)
    if (again := device.on - begun) > max(off, case.allowed) + WATCHED / 2.0:
        problems.append(f"the output came back after {again:.3f} s")
    return Seen(case, off, still, latched, _gone_on(stand, case), tuple(problems))


def _latched(stand: WatchedStand) -> str:
    watch = stand.watch
    off = (CeilingState.FAULT, CeilingState.DISARMED)
    latches = {"supervisor": watch.supervisor.stop, "motor": watch.ceiling.mode in off,
               "exciter": bool(watch.exciter.fault)}  # fmt: skip
    return ", ".join(name for name, latched in latches.items() if latched) or "nothing"


def _gone_on(stand: WatchedStand, case: Case) -> str:
    """Do what a person may do, the least first; return what was enough until the exciter was on."""
    done: list[str] = []
    for drive in ("", "excitation_node", "supervisor_node", "excitation_node"):
        if drive and not _asked(stand, f"{drive}/rearm"):
            continue
        if drive:
            done.append({"excitation_node": "arm exciter", "supervisor_node": "arm motor"}[drive])
        end = time.monotonic() + _PATIENCE  # a node that has opened its device has not answered meanwhile
        while not stand.watch.supervisor.permit and time.monotonic() < end:
            stand.spin()
        command(stand, hold=case.hold)
        end = time.monotonic() + AGAIN
        while not _shakes(stand) and time.monotonic() < end:
            stand.spin()
        if _shakes(stand):
            return ", ".join([*done, "new command"])
    return "more"


def _asked(stand: WatchedStand, name: str) -> bool:
    """Call a service until it succeeds, as a person would who reads why it does not; return whether it has.

    A refusal that only the supervisor's rearm takes away is one at once.
    """
    end = time.monotonic() + (_ANSWER if name.startswith("supervisor") else _PATIENCE)
    while time.monotonic() < end:
        answer = stand.call(Trigger, name, Trigger.Request())
        stand.until(lambda answer=answer: answer() is not None, _ANSWER, name)  # type: ignore[misc]
        found = answer()
        assert found is not None
        if found[0] or "supervisor_node/rearm" in found[1]:
            return found[0]
        _spin(stand, 0.3)
    return False


def _begin(stand: WatchedStand, device: Voltage | Support) -> None:
    """Wait until a run has begun, all the while under a command that is older than it."""
    command(stand)
    stand.until(lambda: stand.ready and stand.watch.exciter.mode == ExcitationState.OFF, _START, "the run begins")
    stand.meet()
    _spin(stand, AGAIN)
    if device.on:
        raise InputError(f"{stand.exciter}: a stand that starts shakes by a command from before")


def measured(events: Sequence[Occurrence], backend: str) -> Iterator[tuple[str, Seen]]:
    """Try all of these events with a backend; yield the name of each, and what was seen of one of its ways."""
    with ExitStack() as stack:
        stand: WatchedStand | None = None
        for event in events:
            for case in event.cases:
                if backend not in case.backends:
                    continue
                for again in (True, False):
                    try:
                        if stand is None:
                            stand = stack.enter_context(watched_stand(exciter=backend))
                            device = Support(stand) if backend == "simulated" else Voltage(stand)
                            stack.callback(device.close)
                            _begin(stand, device)
                        seen = tried(case, stand, device)
                        break
                    except BenchError as error:
                        if not again:
                            raise
                        print(f"{backend}, {case.name}: tried again, since {error}", flush=True)
                        stack.close()
                        stand = None
                yield event.name, seen
                if case.ends:
                    stack.close()
                    stand = None


def table(events: Sequence[Occurrence], backends: Sequence[str], found: Found) -> str:
    """Return the worst of each event as a Markdown table, times in ms."""
    head = ["event", *(f"`{backend}`" for backend in backends), "allowed", "to go on"]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for name in (event.name for event in events):
        seen = [one for backend in backends for one in found.get((name, backend), [])]
        if not seen:
            continue
        cells = [_worst(found.get((name, backend), [])) for backend in backends]
        allowed = f"{1e3 * max(one.case.allowed for one in seen):.0f}"
        go_on = " or ".join(dict.fromkeys(one.go_on for one in seen))
        lines.append(f"| {' | '.join([name, *cells, allowed, go_on])} |")
    return "\n".join(lines)


def _worst(seen: Sequence[Seen]) -> str:
    """Return the latest end of an output; one that never ends has a constant voltage from some time on."""
    if not seen:
        return "–"
    worst = max(seen, key=lambda one: one.off - one.case.allowed)
    if worst.off > worst.case.allowed + 0.9 * WATCHED:
        return f"constant after {max(0.0, 1e3 * worst.still):.0f}"
    return f"{max(0.0, 1e3 * worst.off):.0f}"


def wrong(seen: Seen, backend: str) -> bool:
    """Return whether an event broke a rule; an NI module alone keeps a constant voltage that nobody can reach."""
    unreachable = backend == "nidaqmx" and seen.case.allowed > WATCHDOG
    late = (seen.still if unreachable else seen.off) > (AFTER_SILENCE if unreachable else seen.case.allowed)
    return late or (bool(seen.problems) and not unreachable) or seen.go_on == "more"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of this study."""
    parser.add_argument("--only", type=text, default="", metavar="WORDS", help="events whose name has these words")
    parser.add_argument("--backend", choices=BACKENDS, help="this one alone; default: all")
    parser.add_argument("--page", type=file_path, metavar="FILE.md", help="page whose table is made anew")


def run(arguments: argparse.Namespace) -> int:
    """Print the table; return 3 where an output was on for longer than it is allowed to, or came back."""
    events = [event for event in EVENTS if arguments.only in event.name]
    if not events:
        allowed = ", ".join(event.name for event in EVENTS)
        raise InputError(f"--only: given {arguments.only!r}; allowed: words of {allowed}")
    backends, broken, found = [arguments.backend] if arguments.backend else BACKENDS, 0, Found()
    for backend in backends:
        for name, seen in measured(events, backend):
            found.setdefault((name, backend), []).append(seen)
            broken += wrong(seen, backend)
            what = [f"off after {1e3 * seen.off:.0f} ms", f"still after {1e3 * seen.still:.0f} ms", seen.latched,
                    seen.go_on, *seen.problems]  # fmt: skip
            print(f"{backend}, {seen.case.name}: {'; '.join(what)}", flush=True)
    made = table(events, backends, found)
    print(made)
    print(f"{sum(map(len, found.values()))} events, {broken} that broke a rule")
    if arguments.page:
        into(arguments.page, made, "exciter-stops")
    return NUMERICAL_FAILURE if broken else DONE
