# SPDX-License-Identifier: Apache-2.0
"""Real-time priority and locked memory of a process, where the machine allows them."""

import ctypes
import os
from contextlib import suppress

#: Priority of the loop's nodes by default: above every program without one.
LOOP_PRIORITY = 10
#: sys/mman.h of Linux: pages there are, pages to come, each locked when it is first touched.
_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
#: What gives the right to either.
_RIGHT = "{} in /etc/security/limits.conf, or root"


def request(priority: int, lock_memory: bool) -> list[str]:
    """Give every thread of this process the `priority` of SCHED_FIFO (1 to 99; 0: none) and lock its memory.

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


def _prioritised(priority: int) -> str:
    if refused := refusal(priority):
        return refused
    threads = [int(name) for name in os.listdir("/proc/self/task")]
    parameter = os.sched_param(priority)
    # reset on fork: what a node starts is no part of the loop
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    # the middleware's own threads, which take the samples in
    for thread in threads:
        with suppress(ProcessLookupError):  # ended just now
            os.sched_setscheduler(thread, policy, parameter)
    return f"real-time priority {priority} (SCHED_FIFO) for {len(threads)} threads"


def _locked() -> str:
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_CURRENT | _FUTURE | _ON_FAULT):
        reason = os.strerror(ctypes.get_errno())
        return f"memory cannot be locked ({reason}): {_RIGHT.format('memlock')}"
    return "memory locked"
