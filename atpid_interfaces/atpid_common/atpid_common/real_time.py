# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Real-time priority and locked memory of a process, where the machine allows them."""

import ctypes
import os
from contextlib import suppress
from pathlib import Path

#: Priority of the loop's nodes by default: above every program without one.
LOOP_PRIORITY = 10
#: sys/mman.h of Linux: pages there are, pages to come, each locked when it is first touched.
_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
#: What gives the right to either.
_RIGHT = "{} in /etc/security/limits.conf, or root"


def request(priority: int, lock_memory: bool) -> list[str]:
    """Give the threads that the loop waits for the `priority` of SCHED_FIFO (1 to 99; 0: none), and lock the memory.

    Those are the main one, which calls the node, and the middleware's, which take the samples in. What computes or
    writes beside them, and whatever is started later, would keep other programs from a processor.
    Returns what was done and what was refused, with the reason, one sentence each; nothing where nothing was asked.
    """
    done = [_prioritised(priority)] if priority else []
    return done + ([_locked()] if lock_memory else [])


def refusal(priority: int) -> str:
    """Return why this process could not have the `priority` of SCHED_FIFO, in one sentence; empty: it could.

    Priority 0 is always allowed. Nothing stays changed.
    """
    if not priority:
        return ""
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"real-time priority {priority} is not allowed ({error.strerror}): {_RIGHT.format('rtprio')}"
    os.sched_setscheduler(0, policy, parameter)
    return ""


def as_main_thread() -> None:
    """Give the calling thread the priority of the process's main one: what is started later does not inherit it."""
    main = os.getpid()
    with suppress(OSError):
        os.sched_setscheduler(0, os.sched_getscheduler(main), os.sched_getparam(main))


def _prioritised(priority: int) -> str:
    if refused := refusal(priority):
        return refused
    parameter = os.sched_param(priority)
    # reset on fork: what a node starts is no part of the loop
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    threads = _awaited()
    for thread in threads:
        with suppress(ProcessLookupError):  # ended just now
            os.sched_setscheduler(thread, policy, parameter)
    return f"real-time priority {priority} (SCHED_FIFO) for {len(threads)} threads"


def _awaited() -> list[int]:
    """Return the main thread, and those that have a name of their own: others have the process's."""
    tasks = {int(task.name): (task / "comm").read_text() for task in Path("/proc/self/task").iterdir()}
    return [thread for thread, name in tasks.items() if thread == os.getpid() or name != tasks[os.getpid()]]


def _locked() -> str:
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_CURRENT | _FUTURE | _ON_FAULT):
        reason = os.strerror(ctypes.get_errno())
        return f"memory cannot be locked ({reason}): {_RIGHT.format('memlock')}"
    return "memory locked"
