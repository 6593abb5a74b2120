# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Real-time priority and locked memory: in force where they are allowed, one line where they are not."""

import os
import resource
import subprocess
import sys

import pytest

from atpid_common.real_time import refusal, request

#: In a process of its own, with a thread that has a name of its own, as the middleware's have, and one without.
ASK = """
import ctypes, os, threading
from atpid_common.real_time import refusal, request
wait, named = threading.Event(), threading.Event()
def listen():
    ctypes.CDLL(None).prctl(15, b"dds.udp", 0, 0, 0)  # PR_SET_NAME
    named.set()
    wait.wait()
others = [threading.Thread(target=target) for target in (listen, wait.wait)]
for other in others:
    other.start()
named.wait()
print(*request(10, True), "refusal: " + refusal(10), sep="; ")
threads = [os.getpid(), *(other.native_id for other in others)]
print([os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK for thread in threads])
print(next(line for line in open("/proc/self/status") if line.startswith("VmLck")))
wait.set()
for other in others:
    other.join()
"""

#: The same for a thread that is started later.
LATER = """
import os, threading
from atpid_common.real_time import as_main_thread, request
def run():
    before = os.sched_getscheduler(0)
    as_main_thread()
    print(before, os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority)
request(10, False)
later = threading.Thread(target=run)
later.start()
later.join()
"""


ALLOWED = os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[1] >= 10
needs_priority = pytest.mark.skipif(not ALLOWED, reason="this user may have no real-time priority")


def printed(code: str, *before: str) -> list[str]:
    done = subprocess.run([*before, sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_nothing_asked_is_nothing_done() -> None:
    before = os.sched_getscheduler(0)
    assert request(0, False) == []
    assert refusal(0) == ""
    assert ALLOWED or "priority 10" in refusal(10)
    assert os.sched_getscheduler(0) == before


@needs_priority
def test_the_threads_that_the_loop_waits_for_have_the_priority_and_the_memory_is_locked() -> None:
    said, policies, locked = printed(ASK)[:3]
    if "not allowed" in said:
        pytest.skip(f"not in this container: {said}")
    priority, memory, refused = said.split("; ")
    assert all(part in priority for part in ("priority 10", "SCHED_FIFO", "2 threads"))
    assert "locked" in memory
    assert refused == "refusal: "
    assert policies == f"[{os.SCHED_FIFO}, {os.SCHED_FIFO}, {os.SCHED_OTHER}]"
    assert int(locked.split()[1]) > 1000  # [kB]


@needs_priority
def test_a_thread_that_is_started_later_takes_the_priority_of_the_main_one() -> None:
    if refused := refusal(10):
        pytest.skip(f"not in this container: {refused}")
    assert printed(LATER) == [f"{os.SCHED_OTHER} {os.SCHED_FIFO} 10"]


@pytest.mark.skipif(os.geteuid() != 0, reason="takes the rights of root away")
def test_what_is_not_allowed_is_one_line_each_and_the_process_goes_on() -> None:
    said, policies, *_ = printed(ASK, "setpriv", "--inh-caps", "-all", "--bounding-set", "-sys_nice,-ipc_lock")
    priority, memory, refused = said.split("; ")
    for text in (priority, refused):
        assert all(part in text for part in (" 10 ", " not "))
    assert "rtprio" in priority
    assert "memory" in memory
    assert policies == f"[{os.SCHED_OTHER}, {os.SCHED_OTHER}, {os.SCHED_OTHER}]"
