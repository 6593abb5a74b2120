# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each way to stop the exciter while it runs, over the whole emulated stand, by the voltage of the stand-in device.

`python -m studies exciter-stops --page docs/excitation_output.md` takes five minutes and puts the table into that page.
"""

import argparse
import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from atpid_interfaces.msg import ExcitationState
from lifecycle_msgs.msg import Transition
from std_srvs.srv import Trigger

from atpid_common.arguments import file_path, text
from atpid_common.errors import DONE, NUMERICAL_FAILURE, InputError
from atpid_driver.standins.outputs import Outputs
from studies.stop_chain import AFTER_SILENCE, WAYS, Way, hung, into, killed, service, transition
from studies.watched_stand import AMPLITUDES, Answer, WatchedStand, watched_stand

#: Arguments of the example in the help.
EXAMPLE = "--only stop"
#: Off within so much of the range [V]; the voltage is looked at that often, and for so long after a stop [s].
OFF_VOLTS, LOOK, WATCHED = 5e-3, 5e-4, 1.2
#: What the operator commands: amplitude [m], frequency [Hz]. The output has run for so long before a stop [s].
TONE, RUN = (AMPLITUDES[1] / 2.0, 5.4), 0.5
#: Silence of commands after which the node ramps down, a parameter, is no delay of the chain [s].
COMMANDS_SILENT = 1.2 + AFTER_SILENCE
#: A needed node that hangs, and is not killed, is noticed by the supervisor after its `answer_time`, 0.4 s [s].
NOTICED = 0.65
_START = 240.0


class Voltage:
    """Looks at the output all the time, in a thread of its own."""

    def __init__(self, file: Path) -> None:
        """Begin; file: of the device's outputs."""
        self._outputs = Outputs(file)
        self.on = 0.0  # when it was last on [s], steady
        self._ended = False
        self._thread = threading.Thread(target=self._look, name="voltage")
        self._thread.start()

    def _look(self) -> None:
        while not self._ended:
            before = time.monotonic()
            if abs(self._outputs.between()) > OFF_VOLTS:
                self.on = before
            time.sleep(LOOK)

    def close(self) -> None:
        """End it."""
        self._ended = True
        self._thread.join()


def _output_process(stand: WatchedStand) -> Callable[[], Answer | None]:
    node = stand.node("excitation_node")
    for task in Path(f"/proc/{node}/task").iterdir():
        for child in (task / "children").read_text().split():
            if b"outlet_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)
    return lambda: (True, stand.watch.exciter.fault) if stand.watch.exciter.fault else None


def _no_commands(stand: WatchedStand) -> Callable[[], Answer | None]:
    stand.watch.tone = None
    return lambda: (True, "event: stale")


OWN = (
    Way("service `excitation_node/stop`", service(Trigger, "excitation_node/stop", Trigger.Request())),
    Way("lifecycle `deactivate` of excitation_node",
        transition("excitation_node", Transition.TRANSITION_DEACTIVATE)),
    hung("excitation_node"),
    Way("its output process killed", _output_process, AFTER_SILENCE),
    Way("silence of commands (`stale_timeout` 1.2 s)", _no_commands, COMMANDS_SILENT),
)  # fmt: skip
_SHARED = (
    "live page: Stop", "service `supervisor_node/stop`", "Enter at the terminal",
    "abort level passed, from the first sample on", "supervisor_node hung", "identifier_node hung",
    "Ctrl-C at the terminal", "SIGTERM of the stand's process", "the stand's process killed", "supervisor_node killed",
    "identifier_node killed",
)  # fmt: skip
SHARED = [replace(way, allowed=NOTICED if way.name == "identifier_node hung" else AFTER_SILENCE)
          if way.name.endswith(("hung", "killed")) else way
          for way in WAYS if way.name in _SHARED]  # fmt: skip
ALL = (
    *OWN, *(way for way in SHARED if not way.ends), *(way for way in SHARED if way.ends),
    killed("excitation_node", AFTER_SILENCE),
)  # fmt: skip


def tried(way: Way, stand: WatchedStand, voltage: Voltage) -> float:
    """Try a way while the exciter runs; return after how long its voltage was off for good [s]."""
    _run(stand)
    begun = time.monotonic()
    answered, allowed = way.act(stand), WATCHED + way.allowed
    while time.monotonic() - begun < allowed:
        stand.spin()
        answered()
    return voltage.on - begun


def _run(stand: WatchedStand) -> None:
    """Let it run by a new command: arm motor and exciter where they were stopped."""
    stand.watch.tone = TONE
    stand.watch.decision += 1
    armed, since = time.monotonic(), 0.0

    def runs() -> bool:
        nonlocal armed, since
        mode, now = stand.watch.exciter.mode, time.monotonic()
        if mode in (ExcitationState.OFF, ExcitationState.FAULT) and now - armed > 2.0 and stand.ready:
            stand.arm()
            armed = now
        since = (since or now) if mode == ExcitationState.RUNNING else 0.0
        return bool(since and now - since > RUN)

    stand.until(runs, _START, "the exciter runs")
    stand.remember()


def _begun(stand: WatchedStand) -> WatchedStand:
    stand.until(lambda: stand.ready, _START, "the run begins")
    stand.meet()
    return stand


def measured(ways: Sequence[Way]) -> list[tuple[Way, float]]:
    """Return how long each way took [s]."""
    found = []
    with ExitStack() as stack:
        stand: WatchedStand | None = None
        for way in ways:
            if stand is None:
                stand = _begun(stack.enter_context(watched_stand(commanded=True)))
                voltage = Voltage(stand.place / "output")
                stack.callback(voltage.close)
            off = tried(way, stand, voltage)
            found.append((way, off))
            print(f"{way.name}: {1e3 * off:.0f} ms, allowed {1e3 * way.allowed:.0f} ms", flush=True)
            if way.ends:
                stack.close()
                stand = None
            else:
                way.undo(stand)
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of this study."""
    parser.add_argument("--only", type=text, default="", metavar="WORDS", help="ways whose name has these words")
    parser.add_argument("--page", type=file_path, metavar="FILE.md", help="page whose table is made anew")


def run(arguments: argparse.Namespace) -> int:
    """Print the table; return 3 where one took longer than it is allowed to."""
    ways = [way for way in ALL if arguments.only in way.name]
    if not ways:
        raise InputError(f"--only: given {arguments.only!r}; allowed: words of {', '.join(way.name for way in ALL)}")
    found = measured(ways)
    rows = [f"| {way.name} | {1e3 * off:.0f} ms | {1e3 * way.allowed:.0f} ms |" for way, off in found]
    made = "\n".join(["| way | output off after | allowed |", "|---|---|---|", *rows])
    print(made)
    if arguments.page:
        into(arguments.page, made, "exciter-stops")
    return NUMERICAL_FAILURE if any(off > way.allowed for way, off in found) else DONE
