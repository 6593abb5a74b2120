# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, with bad input in one line and Ctrl-C once or twice; and the node of a command."""

import gc
import inspect
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType
from typing import Any, TypeVar, cast

import rclpy
import rclpy.logging
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_rmw_implementation_identifier

from atpid_common.errors import BAD_INPUT, DONE, AtpidError
from atpid_common.interrupt import Interrupt, waking
from atpid_common.middleware import confine, named_domain
from atpid_common.nodes.held_up import ClockStepWatch, leaving
from atpid_common.nodes.parameters import ParameterError, declare, refuse_undeclared
from atpid_common.nodes.single_instance import claim, starting
from atpid_common.nodes.turns import TurnExecutor
from atpid_common.parameters import Entry
from atpid_common.real_time import LOOP_PRIORITY, request

N = TypeVar("N", bound=Node)
#: How soon a signal is noticed at the latest [s].
TURN = 0.1
#: Exit status after an error that is not the user's.
FAILED = 1
#: How long a node that takes its time from /clock waits for a publisher there, which discovery shows late [s].
_CLOCK_WAIT = 5.0
_PRIORITY = f"priority of the process, SCHED_FIFO; 0: as any other program; the loop's nodes: {LOOP_PRIORITY}"
#: Of every node that is a process of its own.
PARAMETERS = (
    Entry("real_time_priority", 0, _PRIORITY, "", 0, 99),
    Entry("lock_memory", False, "keep the process in memory, so that no page has to be fetched"),
)


def run_node(
    make: Callable[[], Node], args: Sequence[str] | None = None, *, priority: int = 0, gather: float = 0.0
) -> int:
    """Run the node that `make` returns until it is done or interrupted; return the exit status.

    `priority`: its real-time priority by default, except in lockstep, where nothing depends on a clock; `gather`: how
    long messages may wait, so that fewer turns take them [s].
    A node that may end by itself has `done`, a Future of its exit status; one that publishes something before it is
    destroyed does so in `close`.

    SIGINT and SIGTERM end it in order with status 0; further signals, which `ros2 launch` may send, change nothing.
    While the node is being made, the first signal ends the process at once: nothing is open yet.
    """
    node: Node | None = None
    status = FAILED
    with Interrupt() as interrupt:
        try:
            with _rcl_silent():
                initialise(args)
            with starting():
                node = make()
            interrupt.defer()
            lockstep = node.has_parameter("lockstep") and node.get_parameter("lockstep").value
            wanted = declare(node, (replace(PARAMETERS[0], default=0 if lockstep else priority), *PARAMETERS[1:]))
            refuse_undeclared(node)
            if not lockstep:
                _keep_clock(node, interrupt)
            with claim(node.get_fully_qualified_name()):
                for line in request(wanted["real_time_priority"], wanted["lock_memory"]):
                    node.get_logger().info(line)
                status = _spin(node, interrupt, gather)
        except BaseException as error:
            # a library that is being loaded may turn KeyboardInterrupt into an error of its own
            found = DONE if interrupt.raised else _status_after(error, begun=node is not None or interrupt.received)
            if found is None:
                raise
            status = found
        finally:
            interrupt.defer()
            if node is not None:
                getattr(node, "close", lambda: None)()
            with leaving(status):
                if node is not None:
                    node.destroy_node()
                rclpy.try_shutdown()
    return status


def initialise(args: Sequence[str] | None = None, **options: Any) -> None:
    """Initialise rclpy as every process of the project does: on this machine only where that was asked for.

    args: None: those of the process. options: of `rclpy.init`. Raises DomainError for a domain that does not exist.
    """
    named_domain()
    confine(get_rmw_implementation_identifier())
    # rclpy's own handlers shut the context down in another thread, under a callback that is publishing
    given = None if args is None else list(args)
    rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO, **options)


def _keep_clock(node: Node, interrupt: Interrupt) -> None:
    """Let `use_sim_time` change no more. Raises ParameterError where it is set and nothing publishes a time.

    Without one every stamp would be 0. In lockstep time is that of the messages, and no clock is read.
    """
    name = "use_sim_time"
    text = "time is that of /clock, which something has to publish; false: that of this computer"
    kind = ParameterType.PARAMETER_BOOL
    node.set_descriptor(name, ParameterDescriptor(name=name, type=kind, description=text, read_only=True))
    if not node.get_parameter(name).value:
        return
    deadline = time.monotonic() + _CLOCK_WAIT
    while not node.count_publishers("/clock") and not interrupt.received:
        if time.monotonic() > deadline:
            where = f"parameter {name} of {node.get_name()}: given True, and nothing publishes /clock"
            raise ParameterError(f"{where}; leave it out, or start what publishes it first")
        time.sleep(TURN)


@contextmanager
def _rcl_silent() -> Iterator[None]:
    """Keep rcl from logging what it raises as well: bad arguments are reported in one line."""
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.FATAL)
    yield
    if rclpy.logging.get_logger_level("rcl") == LoggingSeverity.FATAL:  # not set by --log-level
        rclpy.logging.set_logger_level("rcl", LoggingSeverity.UNSET)


def _status_after(error: BaseException, begun: bool) -> int | None:
    """Return the exit status after an error, which is printed in one line; None for a defect."""
    if isinstance(error, (KeyboardInterrupt, ExternalShutdownException)):
        return DONE
    if isinstance(error, AtpidError):
        text, status = str(error), error.status
    elif isinstance(error, ParameterException):
        text, status = f"parameter: {error}", BAD_INPUT
    elif isinstance(error, RuntimeError) and not begun:  # arguments rcl cannot use: such as a missing parameter file
        text, status = _in_words(error), BAD_INPUT
    else:
        return None
    print(f"error: {text.splitlines()[0]}", file=sys.stderr)
    return status


def _in_words(error: RuntimeError) -> str:
    """Return rcl's error about its arguments without the place in its source."""
    found = re.search(r"Couldn't parse params file: '--params-file (.*?)'\. Error: (.*?), at ", str(error))
    if found is None:
        return str(error)
    problem = "cannot be opened" if found[2] == "Error opening YAML file" else found[2]
    return f"parameter file {found[1]}: {problem}"


def _spin(node: Node, interrupt: Interrupt, gather: float) -> int:
    """Spin until the node is done or a signal came; return the exit status."""
    done: Future | None = getattr(node, "done", None)
    executor = TurnExecutor(gather)
    executor.add_node(node)
    # Done now, since it would hold up a callback once, for 50 ms and more: rclpy looks up the caller of a log message,
    # and the first look-up goes through the files of all modules; what was made so far need not be collected in mid-run
    inspect.getframeinfo(cast(FrameType, inspect.currentframe()))
    gc.collect()
    gc.freeze()
    with ClockStepWatch(node, executor), waking(executor.wake):
        while not (done and done.done()) and not interrupt.received:
            executor.spin_once(timeout_sec=TURN)
    executor.shutdown()
    return int(done.result()) if done and done.done() else DONE


@contextmanager
def command_node(make: Callable[[], N], *words: str) -> Iterator[tuple[N, TurnExecutor]]:
    """Initialise rclpy, by the `words` of its command line, without signal handlers of its own.

    Yields the node that `make` returns, and its executor.
    """
    initialise(words)
    try:
        node, executor = make(), TurnExecutor()
        executor.add_node(node)
        try:
            with waking(executor.wake):
                yield node, executor
        finally:
            executor.shutdown()
            with leaving(FAILED):
                node.destroy_node()
    finally:
        rclpy.try_shutdown()
