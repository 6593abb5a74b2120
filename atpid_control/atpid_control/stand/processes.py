# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes: started together, watched, and stopped one after the other so that the bag is complete."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType

from atpid_common.interrupt import ENDING_SIGNALS
from atpid_control.stand.parameters import BenchError, NodeDiedError
from atpid_driver.clock import time_base_ns

#: How long a node may take to end after SIGINT, and after SIGTERM, before it is killed [s].
_TIMEOUT = 10.0
_LAST_LINES = 3
_ERROR = "error: "  # begins the line with which a node refuses its input
#: Nodes that may be started again in mid-run: they hold nothing that the run depends on, and move nothing.
_RESTARTABLE = ("identifier_node", "selector_node")
#: How long one that is started again may take until it answers [s]: on a busy machine its libraries load for 20 s.
RESTART_TIME = 60.0
#: Nodes that a run does not need: where one ends, the run goes on.
_OPTIONAL = ("live_node",)
#: What moves something: ended first.
_MOVING = ("motor_node", "excitation_node", "supervisor_node")
#: What starts a process: it is sent SIGTERM if the bench is killed, so that no node keeps running.
_START = ("setpriv", "--pdeathsig", "TERM")
#: And a node: these signals are blocked until it handles them, so that none is lost or a traceback while Python starts.
START_NODE = ("env", "--block-signal=INT", "--block-signal=TERM", "--block-signal=HUP", *_START)


class NodeProcess:
    """One node's process; its output is written to its log file, or to the terminal where there is none."""

    def __init__(self, name: str, command: Sequence[str], log: Path | None) -> None:
        """Start it, in a session of its own: Ctrl-C at the terminal reaches the bench, which stops them in order."""
        self.name, self.command, self.log = name, command, log
        time_base_ns()  # the nodes inherit it
        environment = os.environ | {"PYTHONUNBUFFERED": "1", "RCUTILS_COLORIZED_OUTPUT": "0"}
        if not Path(command[0]).exists() and shutil.which(command[0]) is None:
            raise BenchError(f"{name}: {command[0]} cannot be started: no such file; `make setup`")
        with log.open("ab") if log else nullcontext() as sink:
            try:
                self.process = subprocess.Popen(
                    [*(START_NODE if name.endswith("_node") else _START), *command],
                    stdin=subprocess.DEVNULL,
                    stdout=sink,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    start_new_session=True,
                )
            except OSError as error:
                raise BenchError(f"{name}: {command[0]} cannot be started: {error.strerror}; `make setup`") from None

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs."""
        return self.process.poll()

    def reason(self) -> str:
        """Return why it ended: the error in its log or, where there is none, the signal and its last lines as one."""
        if self.log is None:
            return "see its output above"
        lines = [line.strip() for line in self.log.read_text(errors="replace").splitlines() if line.strip()]
        errors = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)]
        if errors:
            return errors[-1]
        if self.status is not None and self.status < 0:  # what it logged in order is no reason
            unusual = [line for line in lines if not line.startswith("[INFO]")]
            return " / ".join([f"by {signal.Signals(-self.status).name}", *unusual[-_LAST_LINES:]])
        return " / ".join(lines[-_LAST_LINES:]) or "its log is empty"

    def stop(self) -> None:
        """Stop it: by SIGINT, then SIGTERM, then SIGKILL."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self.status is not None:
                return
            self.process.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_TIMEOUT)


class Processes:
    """All nodes of a run, as a context: leaving it ends all processes."""

    def __init__(self, commands: Iterable[tuple[str, Sequence[str]]], logs: Path | None, *, restarts: int = 0) -> None:
        """Take (name, command) in the order of stopping: the motor first, the recorder last.

        logs: folder of the log files; None: what the nodes print goes to the terminal. restarts: how often, in all,
        a node of `_RESTARTABLE` that was ended by a signal is started again.
        """
        self._commands, self._logs, self._left = list(commands), logs, restarts
        self.nodes: list[NodeProcess] = []

    def __enter__(self) -> Processes:
        time_base_ns(anew=True)  # which the nodes inherit, those started again, too
        try:
            for name, command in self._commands:
                log = self._logs / f"{name}.log" if self._logs else None
                self.nodes.append(NodeProcess(name, command, log))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stop one after the other; a second Ctrl-C must not leave half of them running."""
        with _handled(signal.SIG_IGN):
            for node in self.nodes:
                node.stop()

    @contextmanager
    def motor_first(self) -> Iterator[None]:
        """Interrupt motor, exciter and the supervisor, which both answer to, as soon as this is left: first of all."""
        try:
            yield
        finally:
            for node in self.nodes:
                if node.name in _MOVING:
                    node.process.send_signal(signal.SIGINT)  # `stop` does so again, which changes nothing

    def check(self, except_for: str) -> list[str]:
        """Look whether all nodes but `except_for` run; return a line for each started again, or not needed.

        Raises NodeDiedError, with its name and the reason, for one that has ended and is neither.
        """
        restarted = []
        for place, node in reversed(list(enumerate(self.nodes))):
            if node.status is None or node.name == except_for:
                continue
            ended = f"{node.name} ended with status {node.status}"
            if node.name in _OPTIONAL:
                del self.nodes[place]
                restarted.append(f"{ended}: {node.reason()}; the run goes on without it")
                continue
            # one that ended by itself refused its input, and would again
            if node.status >= 0 or node.name not in _RESTARTABLE or not self._left:
                where = f" (whole log: {node.log})" if node.log else ""
                raise NodeDiedError(f"{ended}: {node.reason()}{where}")
            self._left -= 1
            self.nodes[place] = NodeProcess(node.name, node.command, node.log)
            again = f"is started again, which may take {RESTART_TIME:g} s"
            restarted.append(f"{ended} and {again}; {self._left} restarts are left")
        return restarted

    def __getitem__(self, name: str) -> NodeProcess:
        return next(node for node in self.nodes if node.name == name)


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGINT, SIGTERM and SIGHUP, in a shell's background jobs too, for an orderly end.

    Until this is left the first one is the last: `ros2 launch` passes Ctrl-C on to a process that has received it from
    the terminal, and a second one would tear that end.
    """

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in ENDING_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    with _handled(interrupt):
        yield


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], None] | signal.Handlers) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)
