# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the packages share in small: percentiles of latencies, the words of the messages, notes of what takes long."""

import math
import os
import re
import resource
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from enum import IntEnum
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st
from spun import Spun

from atpid_common.cli import run_commands
from atpid_common.latency import ANOTHER_CLOCK, COUNT, Latencies, percentile
from atpid_common.nodes.parameters import LiveParameters
from atpid_common.parameters import Entry
from atpid_common.real_time import refusal, request
from atpid_common.testing import test_every_file_has_its_notice  # noqa: F401  # is a test here too
from atpid_common.vocabulary import EventKind, ExciterKind, ExciterMode, Mode, Origin, Quality, RunState, Severity

MESSAGES = Path(__file__).resolve().parents[2] / "atpid_interfaces" / "msg"


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_at_least_that_share_of_the_values_is_not_larger(values: list[float], share: float) -> None:
    found = percentile(values, share)
    assert found in values
    assert sum(value <= found for value in values) >= share * len(values) - 1e-9
    assert sum(value < found for value in values) < share * len(values)


def test_only_the_latest_count_of_one_clock_and_of_nothing_there_is_none() -> None:
    latencies = Latencies()
    for nanoseconds in (500_000_000, 2_000_000):
        for _ in range(COUNT):
            latencies.add(nanoseconds)
    latencies.add(round(2.0 * ANOTHER_CLOCK * 1e9))
    names = [f"stage {which} [ms]" for which in ("p50", "p99", "max")]
    assert latencies.values("stage") == dict.fromkeys(names, "2.0")
    assert Latencies().values("stage") == dict.fromkeys(names, "nan")
    assert math.isnan(percentile([], 0.5))


def numbers(*kinds: type[IntEnum]) -> dict[str, object]:
    return {constant.name: int(constant) for kind in kinds for constant in kind}


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("CeilingState", numbers(Mode)),
        ("Excitation", numbers(Quality, Origin)),
        ("ExcitationCommand", numbers(ExciterKind)),
        ("ExcitationState", numbers(ExciterMode)),
        ("SupervisorState", numbers(RunState)),
        ("Event", numbers(Severity) | {name: kind for name, kind in vars(EventKind).items() if name.isupper()}),
    ],
)
def test_the_constants_are_those_of_the_message(message: str, expected: dict[str, object]) -> None:
    text = (MESSAGES / f"{message}.msg").read_text()
    found = re.findall(r"^(?:uint8|string) ([A-Z_]+)=(\S+)", text, re.MULTILINE)
    assert {name: value.strip('"') if '"' in value else int(value) for name, value in found} == expected


def test_a_quality_that_no_message_has_is_poor() -> None:
    assert Quality(17) is Quality.POOR


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


TABLE = (Entry("dead_band", 0.01, "relative change that moves nothing", "-", 0.0, 0.9, live=True),)
Ask = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def parameters() -> Iterator[LiveParameters]:
    """Those of a node that a thread spins."""
    ended = threading.Event()
    with closing(Spun("tested")) as pair:
        made = LiveParameters(pair.node, TABLE)
        made.follow(lambda value: value("dead_band"), lambda _: None, lambda *_: None)
        thread = threading.Thread(target=pair.until, args=(ended.is_set,), name="session-node")
        thread.start()
        yield made
        ended.set()
        thread.join()


@pytest.fixture
def ask(parameters: LiveParameters, capsys: pytest.CaptureFixture[str]) -> Ask:
    def asked(what: str, *words: str) -> tuple[int, str, str]:
        commands = {"": {"ros param": ("atpid_common.nodes.ros_commands:PARAM", "param")}}
        with patch.dict(os.environ):  # which the command confines to this machine
            status = run_commands("atpid", "", commands, ["ros", "param", what, "/tested", *words])
        out, error = capsys.readouterr()
        return status, out.strip(), error.strip()

    return asked


def test_a_parameter_is_read_and_set_and_what_cannot_be_is_one_line(ask: Ask, parameters: LiveParameters) -> None:
    assert ask("get", "dead_band") == (0, "0.01", "")
    assert ask("set", "dead_band", "0.02") == (0, "dead_band: 0.02", "")
    assert parameters["dead_band"] == 0.02
    assert "0 to 0.9" in ask("describe", "dead_band")[1]
    for words in (("set", "dead_band", "-1.0"), ("get", "nothing")):
        status, out, error = ask(*words)
        assert (status, out, len(error.splitlines())) == (2, "", 1)
        assert error.startswith("error: ")
        assert words[1] in error
