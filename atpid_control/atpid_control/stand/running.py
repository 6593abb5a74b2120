# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs the graph: in lockstep, all nodes in this process, or in real time, each node a process as on the stand.

Only nodes/ imports rclpy; it is imported when a run begins, so that this module is read and tested without it.
"""

import argparse
import math
import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from atpid_common.injected_faults import RECORDER, Injected
from atpid_common.waiting import to_stderr
from atpid_control.stand.parameters import BenchError, PlantFailedError
from atpid_control.stand.parts import REAL_TIME_PARTS, Part, enclave_of
from atpid_control.stand.processes import Processes

if TYPE_CHECKING:
    from atpid_control.stand.nodes.composition import BenchWatch


@contextmanager
def shown(duration: float, label: str) -> Iterator[Callable[[float], None]]:
    """Yield a function that shows the time reached [s] of `duration` [s]; the bar goes to standard error."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:5.1f} of {task.total:g} s"),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=duration, speed="")
        begun: float | None = None

        def update(reached: float) -> None:
            nonlocal begun
            now = time.monotonic()
            begun = now if begun is None else begun
            speed = f"{reached / (now - begun):.1f} x real time" if now > begun else ""
            bar.update(task, completed=min(reached, duration), speed=speed)

        yield update


#: Five interpreters load their libraries, and after an update compile their kernels, before the first handshake [s].
_START_TIMEOUT = 180.0
#: Data may stop for so long before the run is ended [s].
_LOOP_TIMEOUT = 20.0
_FAILED = 3
_RECORDER = "recorder_node"


Commands = list[tuple[str, list[str]]]


@dataclass(frozen=True)
class RosOptions:
    """What all nodes of a run get on their command line, and what runs beside them."""

    namespace: str = ""  # /NAME; empty: none
    log_level: str = ""  # empty: that of ROS
    restarts: int = 0  # how often, in all, a killed identifier or selector is started again

    @classmethod
    def of(cls, args: argparse.Namespace) -> "RosOptions":
        """Return those of a command line."""
        return cls(args.namespace or "", args.log_level or "", args.restarts)

    @property
    def words(self) -> list[str]:
        """What follows `--ros-args`."""
        moved = ["-r", f"__ns:={self.namespace}"] if self.namespace else []
        return moved + (["--log-level", self.log_level] if self.log_level else [])


#: Of a run without any.
PLAIN = RosOptions()


def command_of(part: Part, parameter_file: Path, ros: RosOptions) -> tuple[str, list[str]]:
    """Return (name, command) of a node."""
    words = ["--enclave", enclave_of(part.name), "--params-file", str(parameter_file), *ros.words]
    return part.name, [str(part.executable), "--ros-args", *words]


def commands_of(parameter_file: Path, parts: Iterable[Part] = REAL_TIME_PARTS, ros: RosOptions = PLAIN) -> Commands:
    """Return (name, command) of every node, in the order of `parts`, which is that of stopping."""
    return [command_of(part, parameter_file, ros) for part in parts]


def keep_running(nodes: Processes, namespace: str = "", seconds: float = math.inf) -> None:
    """Run the nodes until Ctrl-C, which passes through, or for `seconds` of data after the first estimate.

    Raises NodeDiedError where one ends by itself.
    """
    from atpid_control.stand.nodes.composition import watching

    with watching(lambda _text: None, namespace) as (watch, listen), _stop_key(watch.stop_motor), nodes.motor_first():
        while watch.elapsed < seconds:
            _check(nodes, watch, except_for="")
            listen()


def _check(nodes: Processes, watch: "BenchWatch", except_for: str) -> bool:
    """Report what has happened to the nodes; return whether something has. Raises NodeDiedError."""
    texts = nodes.check(except_for)
    for text in texts:
        to_stderr(text)
        watch.restarted(text)
    return bool(texts)


def _on_disk(commands: Commands, faults: Sequence[Injected]) -> Commands:
    """Return the commands, the recorder's with a disk that fails where `faults` have one."""
    if not any(fault.part in RECORDER and fault.kind != "off" for fault in faults):
        return commands
    start = [sys.executable, "-m", "atpid_control.stand.faulty_recorder"]
    return [(name, [*start, *command[1:]] if name == _RECORDER else command) for name, command in commands]


def run_realtime(
    commands: Commands,
    logs: Path,
    progress: Callable[[float], None],
    ros: RosOptions = PLAIN,
    *,
    source: str = "plant_node",
    faults: Sequence[Injected] = (),
) -> None:
    """Run the graph until the node `source` has ended; `progress` is called with the data time [s].

    faults: of these, those of the recorder are applied from outside it.

    What the nodes wait for, or compile, before the first estimate goes to standard error. Raises NodeDiedError, at
    once and with its reason, where a node ends early; PlantFailedError where the plant fails, BenchError where data
    stop. KeyboardInterrupt passes through after all nodes have been stopped and the bag is closed.
    """
    from atpid_control.stand.nodes.composition import watching

    deaths = [fault.begin for fault in faults if fault.part in RECORDER and fault.kind == "off"]
    moves = any(name == "motor_node" for name, _ in commands)  # a replay has no motor
    with (
        Processes(_on_disk(commands, faults), logs, restarts=ros.restarts) as nodes,
        watching(to_stderr, ros.namespace) as (watch, listen),
        _stop_key(watch.stop_motor) if moves else nullcontext(),
        nodes.motor_first() if moves else nullcontext(),
    ):
        last = nodes[source]
        elapsed, since, allowed = 0.0, time.monotonic(), _START_TIMEOUT
        while last.status is None:
            listen()
            if deaths and watch.elapsed >= min(deaths):
                nodes[_RECORDER].process.kill()
                nodes[_RECORDER].process.wait()
            if _check(nodes, watch, except_for=source):
                allowed = _START_TIMEOUT  # the supervisor ends the run where the replacement does not come
            if watch.elapsed != elapsed:
                elapsed, since, allowed = watch.elapsed, time.monotonic(), _LOOP_TIMEOUT
                progress(elapsed)
            elif (silence := time.monotonic() - since) > allowed:
                raise BenchError(f"no estimate for {silence:.0f} s, at {elapsed:.1f} s of the run: see {logs}")
        if last.status == _FAILED:
            raise PlantFailedError(watch.failure or last.reason())
        if last.status != 0:
            nodes.check(except_for="")


#: Between two looks whether a run that was sent to the background is in the foreground again [s].
_AGAIN = 0.2


@contextmanager
def _stop_key(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop`, in another thread, at each Enter; without a terminal there is no key, and nothing is announced.

    A thread, so that no other work delays it.
    """
    if not _in_foreground():
        yield
        return
    to_stderr("Enter stops the motor; Ctrl-C ends the run")
    end, ended = os.pipe()
    thread = threading.Thread(target=_wait, args=(end, stop), name="stop key", daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.close(ended)
        thread.join()
        os.close(end)


def _in_foreground() -> bool:
    """Whether standard input is a terminal that belongs to this process now: another one must not read it."""
    with suppress(OSError, ValueError, AttributeError):  # no standard input at all
        return os.isatty(sys.stdin.fileno()) and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    return False


def _wait(end: int, stop: Callable[[], None]) -> None:
    terminal = sys.stdin.fileno()
    while True:
        watched = [end, terminal] if _in_foreground() else [end]
        ready, _, _ = select.select(watched, [], [], _AGAIN)
        if end in ready:
            return
        if terminal in ready and _in_foreground():
            with suppress(OSError):
                if not os.read(terminal, 4096):
                    return  # closed
            stop()
