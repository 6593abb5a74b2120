# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the middleware of the wheels holds a node up: as it leaves the graph, and where the wall clock is set.

- *Leaving.* Fast DDS 2.14.5 (its issue 6513) holds a lock while it waits for a discovery callback that needs the same
  lock, where a participant is deleted at the moment another one appears or leaves. rclpy keeps the interpreter locked
  meanwhile, so neither a signal's handler nor a thread of Python's can end the process.
- *Steps of the wall clock.* A wait ends at a time of the wall clock, so one that is under way while the clock is set
  back lasts longer by the step, and timers on the steady clock wait with it. Later waits are right.
"""

from __future__ import annotations

import ctypes
import faulthandler
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.executors import Executor
from rclpy.node import Node

#: How long a node may take to release its device and to leave [s]; `ros2 launch` kills it after 10.
_LIMIT = 8.0
_DUMP = 0.5  # for writing the stacks [s]
_SIGEV_THREAD = 2  # of signal.h, Linux: call a function in a thread of the C library's


class _Event(ctypes.Structure):
    """`struct sigevent`, 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signo", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("padding", ctypes.c_char * 32),
    )


class _Times(ctypes.Structure):
    """`struct itimerspec`: interval and first expiry, each seconds and nanoseconds."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("interval", "interval_ns", "seconds", "nanoseconds"))


@contextmanager
def leaving(status: int, limit: float = _LIMIT) -> Iterator[None]:
    """End the process with `status` where the block takes longer than `limit` [s]; the stacks go to standard error.

    Other nodes then see it leave when its lease ends, which is after 20 s.
    """
    library, timer = ctypes.CDLL(None), ctypes.c_void_p()
    event = _Event(status, 0, _SIGEV_THREAD, ctypes.cast(library._exit, ctypes.c_void_p))
    after = _Times(0, 0, *divmod(round((limit + _DUMP) * 1e9), 1_000_000_000))
    faulthandler.dump_traceback_later(limit, file=2)
    if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError("no timer could be created")
    library.timer_settime(timer, 0, ctypes.byref(after), None)
    try:
        yield
    finally:
        library.timer_delete(timer)
        faulthandler.cancel_dump_traceback_later()


#: How often the clocks are compared, and the least difference that is a step [s].
_PERIOD, _LEAST = 0.05, 0.02
_UNDISTURBED = 0.002  # a longer reading of both clocks was interrupted [s]


class ClockStepWatch:
    """Compares wall and steady clock in a thread of its own, whose waits are on the steady clock."""

    def __init__(self, node: Node, executor: Executor) -> None:
        self._node, self._executor = node, executor
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="clock step watch", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        before = _wall_ahead()
        while not self._stop.wait(_PERIOD):
            now = _wall_ahead()
            if abs(now - before) > _LEAST:
                self._executor.wake()
                self._node.get_logger().warning(f"the wall clock was set by {now - before:+.3f} s")
            before = now


def _wall_ahead() -> float:
    """Return by how much the wall clock is ahead of the steady one [s]."""
    while True:
        begin = time.monotonic()
        wall = time.time()
        if time.monotonic() - begin < _UNDISTURBED:
            return wall - begin
