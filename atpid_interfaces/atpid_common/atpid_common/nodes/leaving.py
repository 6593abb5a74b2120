# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bound on the time in which a process leaves the graph, where the middleware of the wheels may wait for ever.

Their Fast DDS 2.14.5 (its issue 6513) holds a lock while it waits for a discovery callback that needs the same lock,
where a participant is deleted at the moment another one appears or leaves. rclpy keeps the interpreter locked
meanwhile, so neither a signal's handler nor a thread of Python's can end the process.
"""

from __future__ import annotations

import ctypes
import faulthandler
import time
from collections.abc import Iterator
from contextlib import contextmanager

#: How long a node may take to release its device and to leave [s]; `ros2 launch` kills it after 10.
LIMIT = 8.0
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
def leaving(status: int, limit: float = LIMIT) -> Iterator[None]:
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
