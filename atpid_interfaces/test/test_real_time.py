# SPDX-License-Identifier: Apache-2.0
"""Real-time priority and locked memory: in force where they are allowed, one line where they are not."""

import os
import resource
import subprocess
import sys

import pytest

from atpid_common.real_time import refusal, request

#: In a process of its own, with a second thread, which must not keep the tests' process at that priority.
_ASK = """
import os, threading
from atpid_common.real_time import refusal, request
wait = threading.Event()
other = threading.Thread(target=wait.wait)
other.start()
print(*request(10, True), "refusal: " + refusal(10), sep="; ")
print([os.sched_getscheduler(int(thread)) & ~os.SCHED_RESET_ON_FORK for thread in os.listdir("/proc/self/task")])
print(next(line for line in open("/proc/self/status") if line.startswith("VmLck")))
wait.set()
other.join()
"""


def allowed() -> bool:
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[1] >= 10


def asked(*before: str) -> list[str]:
    done = subprocess.run([*before, sys.executable, "-c", _ASK], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_nothing_asked_is_nothing_done() -> None:
    before = os.sched_getscheduler(0)
    assert request(0, False) == []
    assert refusal(0) == ""
    assert allowed() or "real-time priority 10 is not allowed" in refusal(10)
    assert os.sched_getscheduler(0) == before


@pytest.mark.skipif(not allowed(), reason="this user may have no real-time priority")
def test_every_thread_has_the_priority_and_the_memory_is_locked() -> None:
    said, policies, locked = asked()[:3]
    if "not allowed" in said:
        pytest.skip(f"not in this container: {said}")
    assert said == "real-time priority 10 (SCHED_FIFO) for 2 threads; memory locked; refusal: "
    assert policies == f"[{os.SCHED_FIFO}, {os.SCHED_FIFO}]"
    assert int(locked.split()[1]) > 1000  # [kB]


@pytest.mark.skipif(os.geteuid() != 0, reason="takes the rights of root away")
def test_what_is_not_allowed_is_one_line_each_and_the_process_goes_on() -> None:
    said, policies, *_ = asked("setpriv", "--inh-caps", "-all", "--bounding-set", "-sys_nice,-ipc_lock")
    assert "real-time priority 10 is not allowed (Operation not permitted): rtprio" in said
    assert "memory cannot be locked" in said
    assert "refusal: real-time priority 10 is not allowed" in said
    assert policies == f"[{os.SCHED_OTHER}, {os.SCHED_OTHER}]"
