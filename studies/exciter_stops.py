# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each event that has to stop the exciter while it runs, with each of its backends, over the whole emulated stand.

What is put out is seen at the device: as the voltage between the stand-in's outputs, or as the support's motion where
the plant is the exciter. `python -m studies exciter-stops --page docs/excitation_output.md` takes an hour and puts the
table into that page.
"""

import argparse
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from atpid_interfaces.msg import CeilingState, ExcitationCommand, ExcitationState, SampleBlock
from std_srvs.srv import Trigger

from atpid_common.arguments import file_path, text
from atpid_common.errors import DONE, NUMERICAL_FAILURE, InputError
from atpid_common.nodes.messages import BLOCKS, nanoseconds_of
from atpid_control.stand.errors import BenchError
from atpid_driver.standins.control import Control
from atpid_driver.standins.outputs import Outputs
from studies.stop_chain import AFTER_SILENCE, AT_ONCE, WAYS, Act, into, service
from studies.watched_stand import AMPLITUDES, Answer, WatchedStand, watched_stand

#: Arguments of the example in the help.
EXAMPLE = "--only disarmed --backend labjack_stream"
BACKENDS = ("simulated", "labjack_dac", "labjack_stream", "nidaqmx")
#: Off within so much [V], [m]; the voltage is looked at that often [s].
OFF_VOLTS, OFF_METRES, LOOK = 5e-3, 1e-3, 5e-4
#: The output has run for so long before an event, and is watched for so long after what is allowed, and after the
#: cause is gone, while the command of before is repeated all the time [s].
RUN, WATCHED, AGAIN = 0.5, 0.5, 0.7
#: What the operator commands [m], [Hz]; a smaller one moves the ceiling. An eccentric drive has its disc's alone.
LARGE, SMALL, DISC, FREQUENCY = AMPLITUDES[1] / 2.0, AMPLITUDES[0], AMPLITUDES[1], 5.4
#: Silence of commands after which the output ramps down, a hold without estimates, and the T7's watchdog: parameters
#: of the node. The firmware's own time until it sees a fault, at most [s].
STALE, BLIND, WATCHDOG, DETECTED = 1.2, 2.0, 3.0, 0.3
#: Of the identification: two periods, which an estimate has of before [s].
WINDOW = 0.4
#: Reading of a laser that is frozen, and one below and above its range [V].
FROZEN, BELOW, ABOVE = 2.0, -10.5, 10.5
#: Of the device that is away for a moment [s], and of a recorded signal that fills the connection [samples].
_AWAY, _SAMPLES = 0.05, 100_000
#: A stand may take so long to start, a service to answer, and a person to try again [s].
_START, _ANSWER, _PATIENCE = 240.0, 15.0, 3.0
NODES = ("supervisor", "motor", "excitation", "labjack", "identifier", "selector", "recorder")
_OUTPUT, _DEVICES = "excitation_node's output process", BACKENDS[1:]


def _nothing(_stand: WatchedStand) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Case:
    """One way in which an event happens."""

    name: str
    act: Act
    allowed: float = AT_ONCE  # until the output is off [s]
    undo: Callable[[WatchedStand], object] = _nothing  # takes the cause away
    before: Callable[[WatchedStand], object] = _nothing  # while the output runs
    ends: bool = False  # the run ends with it
    hold: bool = False  # the command is held on what is measured
    backends: Sequence[str] = BACKENDS


@dataclass(frozen=True)
class Seen:
    """What became of the output: off, and without any change, after [s]; what is latched, what it took to go on."""

    case: Case
    off: float
    still: float
    latched: str
    go_on: str
    problems: tuple[str, ...] = ()


@dataclass
class Row:
    """An event in each of its ways."""

    name: str
    cases: Sequence[Case]
    seen: dict[str, list[Seen]] = field(default_factory=lambda: {backend: [] for backend in BACKENDS})


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


def _output_process(stand: WatchedStand) -> int:
    node = stand.node("excitation_node")
    for task in Path(f"/proc/{node}/task").iterdir():
        for child in (task / "children").read_text().split():
            if b"outlet_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    raise InputError("the output has no process")


def _sent(number: signal.Signals, *names: str) -> Act:
    """Send a signal to nodes, the whole stand, or the output's process, all at once."""

    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        for process in [_output_process(stand) if name == _OUTPUT else stand.node(name) for name in names]:
            os.kill(process, number)
        return lambda: None

    return act


def _goes_on(name: str) -> Callable[[WatchedStand], object]:
    def undo(stand: WatchedStand) -> None:
        with suppress(InputError, ProcessLookupError):  # a process of the output was killed where it hung
            os.kill(_output_process(stand) if name == _OUTPUT else stand.node(name), signal.SIGCONT)

    return undo


def _do(work: Callable[[WatchedStand], object]) -> Act:
    def act(stand: WatchedStand) -> Callable[[], Answer | None]:
        work(stand)
        return lambda: None

    return act


def _set(*values: str) -> Callable[[WatchedStand], object]:
    """Break the emulated stand, or mend it."""
    return lambda stand: [stand.board.do(value if " " not in value else f"set {value}") for value in values]


def _laser(volts: float) -> Act:
    return _do(lambda stand: Control(stand.place / "device").hold(0, volts))


def _sees_again(stand: WatchedStand) -> None:
    Control(stand.place / "device").release(0)


def _unplugged(stand: WatchedStand) -> None:
    Control(stand.place / "exciter").unplug()


def _plugged(stand: WatchedStand) -> None:
    Control(stand.place / "exciter").replug()


def _away(stand: WatchedStand) -> None:
    """Let what is written fail for a moment."""
    _unplugged(stand)
    time.sleep(_AWAY)
    _plugged(stand)


def _moving(stand: WatchedStand) -> None:
    """Command another amplitude, and wait until the ceiling travels."""
    command(stand, SMALL)
    stand.until(
        lambda: stand.watch.ceiling.mode == CeilingState.MOVING and stand.left(stand.board.state()) > 0.1,
        _START, "the ceiling moves",
    )  # fmt: skip


def _at_rest(stand: WatchedStand) -> None:
    """Wait until the ceiling has been at rest for longer than it may coast."""
    moved = time.monotonic()

    def rests() -> bool:
        nonlocal moved
        if stand.watch.ceiling.mode != CeilingState.HOLDING:
            moved = time.monotonic()
        return time.monotonic() - moved > 2.0 * DETECTED

    stand.until(rests, _START, "the ceiling rests")


def _sent_to(stand: WatchedStand) -> None:
    """Let the output's process hang, and command what does not fit into the connection to it."""
    os.kill(_output_process(stand), signal.SIGSTOP)
    samples = np.sin(2.0 * np.pi * FREQUENCY / 2000.0 * np.arange(_SAMPLES))
    stand.watch.publish_signal("large", samples, 2000.0)
    command(stand, LARGE, kind=ExcitationCommand.RECORDED, file="large")


def _silent(stand: WatchedStand) -> None:
    stand.watch.command = None


def _way(name: str, allowed: float = AT_ONCE) -> Case:
    """Return one that stops the ceiling, too."""
    way = next(way for way in WAYS if way.name == name)
    return Case(name, way.act, allowed, way.undo, ends=way.ends)


def _motor(fault: str, *values: str, detected: float = DETECTED, mend: Sequence[str] = (), moving: bool = False) -> Row:
    # an eccentric drive has one amplitude, at which the ceiling stays
    backends = tuple(one for one in BACKENDS if not moving or one != "labjack_dac")
    case = Case(fault, _do(_set(*values)), AT_ONCE + detected, _set(*mend), _moving if moving else _at_rest,
                backends=backends)  # fmt: skip
    return Row(f"motor fault {fault}", [case])


def _signal(number: signal.Signals, *, hangs: bool) -> list[Case]:
    # the last state of a simulated exciter may be lost with it: its plant waits for 0.2 s
    quick = {"stand"} if number == signal.SIGTERM else set()
    return [
        Case(name, _sent(number, name if name == "stand" else f"{name}_node"),
             AT_ONCE if name in quick else AFTER_SILENCE,
             _goes_on(f"{name}_node") if hangs else _nothing, ends=not hangs)
        for name in (NODES if hangs else (*NODES[:5], "stand"))  # those after the identifier end as that does
    ]  # fmt: skip


_TRIGGER = Trigger.Request()
#: Those after which the run goes on share a stand.
ROWS = (
    Row("emergency stop pressed", [Case("pressed", _do(_set("stop open")), undo=_set("stop ok"))]),
    _motor("STALL", "jam 1", mend=["jam 0"], moving=True),
    _motor("WRONG_WAY", "swapped 1", mend=["swapped 0"], moving=True),
    _motor("UNCOMMANDED", "runaway 1", mend=["runaway 0"]),
    _motor("SENSOR_LOW", "sensor open", detected=0.0, mend=["sensor ok"]),
    _motor("SENSOR_HIGH", "sensor high", detected=0.0, mend=["sensor ok"]),
    _motor("SENSOR_JUMP", "slip 50000", detected=0.0, mend=["slip 0"]),
    _motor("BOTH_LIMITS", "lower open", "upper open", detected=0.0, mend=["lower ok", "upper ok"]),
    _motor("WATCHDOG: the board hangs", "hang"),
    _motor("link lost: the board's cable is pulled", "unplug", mend=["plug"]),
    Row("motor disarmed (`motor_node/stop`)", [Case("service", service(Trigger, "motor_node/stop", _TRIGGER))]),
    Row("supervisor's stop (service, live page, Enter, abort level)",
        [_way(name) for name in ("service `supervisor_node/stop`", "live page: Stop", "Enter at the terminal",
                                 "abort level passed, from the first sample on")]),
    Row("exciter's stop (`excitation_node/stop`)",
        [Case("service", service(Trigger, "excitation_node/stop", _TRIGGER))]),
    Row("commands end", [Case("silence", _do(_silent), STALE + AFTER_SILENCE)]),
    Row("SIGSTOP of a node", _signal(signal.SIGSTOP, hangs=True)),
    *(Row(f"laser of the support {what}, with `hold`",
          [Case(what, _laser(volts), BLIND + WINDOW + AFTER_SILENCE, _sees_again, hold=True)])
      for what, volts in (("frozen", FROZEN), ("dead", BELOW), ("saturated", ABOVE))),
    Row("device unplugged",
        [Case("unplugged", _do(_unplugged), WATCHDOG + AFTER_SILENCE, _plugged, backends=_DEVICES)]),
    Row("a write fails (device away for 50 ms)",
        [Case("away", _do(_away), AFTER_SILENCE, backends=_DEVICES)]),
    Row("output process hangs, alone",
        [Case("alone", _sent(signal.SIGSTOP, _OUTPUT), AFTER_SILENCE, _goes_on(_OUTPUT), backends=_DEVICES)]),
    Row("output process hangs while it is sent to",
        [Case("sent to", _do(_sent_to), AFTER_SILENCE, _goes_on(_OUTPUT), backends=_DEVICES)]),
    Row("output process killed",
        [Case("killed", _sent(signal.SIGKILL, _OUTPUT), AFTER_SILENCE, backends=_DEVICES)]),
    Row("Ctrl-C at the terminal", [_way("Ctrl-C at the terminal")]),
    Row("SIGTERM of a node, or of the stand", _signal(signal.SIGTERM, hangs=False)),
    Row("SIGKILL of a node, or of the stand", _signal(signal.SIGKILL, hangs=False)),
    Row("SIGKILL of excitation_node and its output process at once",
        [Case("both", _sent(signal.SIGKILL, "excitation_node", _OUTPUT), WATCHDOG + AFTER_SILENCE, ends=True,
              backends=_DEVICES)]),
)  # fmt: skip


def command(stand: WatchedStand, amplitude: float = LARGE, **values: Any) -> None:
    """Command something new, which is repeated from now on."""
    only = stand.exciter == "labjack_dac"
    values = {"kind": ExcitationCommand.SINE} | values | ({"kind": ExcitationCommand.SINE} if only else {})
    stand.watch.decide(amplitude=DISC if only else amplitude, frequency=FREQUENCY, **values)


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
        answer = stand.call(Trigger, name, _TRIGGER)
        stand.until(lambda answer=answer: answer() is not None, _ANSWER, name)  # type: ignore[misc]
        found = answer()
        assert found is not None
        if found[0] or "supervisor_node/rearm" in found[1]:
            return found[0]
        _spin(stand, 0.3)
    return False


def _begun(stand: WatchedStand) -> tuple[WatchedStand, Voltage | Support]:
    """Wait until a run has begun, all the while under a command that is older than it."""
    device = Support(stand) if stand.exciter == "simulated" else Voltage(stand)
    command(stand)
    stand.until(lambda: stand.ready and stand.watch.exciter.mode == ExcitationState.OFF, _START, "the run begins")
    stand.meet()
    _spin(stand, AGAIN)
    if device.on:
        raise InputError(f"{stand.exciter}: a stand that starts shakes by a command from before")
    return stand, device


def measured(rows: Sequence[Row], backend: str) -> Iterator[Seen]:
    """Try all of these events with a backend; yield what was seen, which is kept in the rows too."""
    with ExitStack() as stack:
        stand: WatchedStand | None = None
        for row in rows:
            for case in row.cases:
                if backend not in case.backends:
                    continue
                for again in (True, False):
                    try:
                        if stand is None:
                            stand, device = _begun(stack.enter_context(watched_stand(exciter=backend)))
                            stack.callback(device.close)
                        seen = tried(case, stand, device)
                        break
                    except BenchError as error:
                        if not again:
                            raise
                        print(f"{backend}, {case.name}: tried again, since {error}", flush=True)
                        stack.close()
                        stand = None
                row.seen[backend].append(seen)
                yield seen
                if case.ends:
                    stack.close()
                    stand = None


def table(rows: Sequence[Row], backends: Sequence[str]) -> str:
    """Return the worst of each event as a Markdown table."""
    head = ["event", *(f"`{backend}`" for backend in backends), "allowed", "latched", "to go on"]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for row in rows:
        seen = [one for backend in backends for one in row.seen[backend]]
        if not seen:
            continue
        cells = [_worst(row.seen[backend]) for backend in backends]
        ways = [" or ".join(dict.fromkeys(getattr(one, name) for one in seen)) for name in ("latched", "go_on")]
        allowed = f"{1e3 * max(one.case.allowed for one in seen):.0f} ms"
        lines.append(f"| {' | '.join([row.name, *cells, allowed, *ways])} |")
    return "\n".join(lines)


def _worst(seen: Sequence[Seen]) -> str:
    """Return the latest end of an output; one that never ends has a constant voltage from some time on."""
    if not seen:
        return "–"
    worst = max(seen, key=lambda one: one.off - one.case.allowed)
    of = f" ({worst.case.name})" if len(seen) > 1 else ""
    if worst.off > worst.case.allowed + 0.9 * WATCHED:
        return f"constant after {max(0.0, 1e3 * worst.still):.0f} ms{of}"
    return f"{max(0.0, 1e3 * worst.off):.0f} ms{of}"


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
    rows = [row for row in ROWS if arguments.only in row.name]
    if not rows:
        raise InputError(f"--only: given {arguments.only!r}; allowed: words of {', '.join(row.name for row in ROWS)}")
    backends, broken = [arguments.backend] if arguments.backend else BACKENDS, 0
    for backend in backends:
        for seen in measured(rows, backend):
            broken += wrong(seen, backend)
            what = [f"off after {1e3 * seen.off:.0f} ms", f"still after {1e3 * seen.still:.0f} ms", seen.latched,
                    seen.go_on, *seen.problems]  # fmt: skip
            print(f"{backend}, {seen.case.name}: {'; '.join(what)}", flush=True)
    made = table(rows, backends)
    print(made)
    count = sum(len(row.seen[backend]) for row in rows for backend in backends)
    print(f"{count} events, {broken} that broke a rule")
    if arguments.page:
        into(arguments.page, made, "exciter-stops")
    return NUMERICAL_FAILURE if broken else DONE
