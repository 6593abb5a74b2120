# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every node that is a process of its own refuses at its start, in one line, and what may not change then."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import closing

import pytest
from rclpy.node import Node
from spun import Spun

from atpid_common.nodes import single_instance
from atpid_common.nodes.node_main import PARAMETERS

#: A node of its own; it prints what a change of use_sim_time is answered, and ends.
NODE = """
import sys
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from atpid_common.nodes.node_main import run_node

class Own(Node):
    def __init__(self):
        super().__init__("own")
        self.done = Future()
        self.declare_parameter("height", 0.1)
        self.create_timer(0.01, self.end)

    def end(self):
        (result,) = self.set_parameters([Parameter("use_sim_time", value=True)])
        if not self.done.done():  # on a busy machine the timer is called once more
            print(result.successful, self.get_clock().now().nanoseconds > 0, result.reason)
            self.done.set_result(0)

sys.exit(run_node(Own))
"""
#: Publishes a time, as a replay does, until it is stopped.
CLOCK = """
import rclpy
from rosgraph_msgs.msg import Clock
from atpid_common.nodes.node_main import initialise
initialise([])
node = rclpy.create_node("clock")
node.create_publisher(Clock, "/clock", 1)
print("ready", flush=True)
rclpy.spin(node)
"""
#: Is interrupted while it is made, by what turns KeyboardInterrupt into another error; or by nothing.
TORN = """
import signal, sys
from atpid_common.errors import InputError
from atpid_common.nodes.node_main import run_node

def make():
    try:
        signal.raise_signal(int(sys.argv[1]))
    except KeyboardInterrupt:
        pass
    raise {error}('torn')

sys.exit(run_node(make, []))
"""
#: Leaves as one does whose middleware holds the interpreter's lock and waits for ever.
STUCK = """
import ctypes, sys
from atpid_common.nodes.held_up import leaving
with leaving(0, limit=5.0):
    pass
with leaving(int(sys.argv[1]), limit=0.1):
    ctypes.PyDLL(None).pause()
"""


def started(code: str, *words: str, **environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", code, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, env=os.environ | environment,
    )  # fmt: skip


def ended(code: str, *words: str, **environment: str) -> tuple[int, str, str]:
    with started(code, *words, **environment) as process:
        printed, errors = process.communicate()
    return process.returncode, printed, errors


def node(*words: str, **environment: str) -> tuple[int, str, str]:
    return ended(NODE, "--ros-args", *words, **environment)


@pytest.mark.parametrize(
    ("words", "environment", "parts"),
    [
        ((), {"ROS_DOMAIN_ID": "lab"}, r"ROS_DOMAIN_ID: .*'lab'.* 0 .* 232"),
        (("-p", "hieght:=0.2"), {}, r"hieght of own\b.*height\?"),
        (("-p", "use_sim_time:=true"), {}, r"use_sim_time of own: .*True.*/clock"),
    ],
)
def test_what_cannot_be_is_refused_at_start(words: tuple[str, ...], environment: dict[str, str], parts: str) -> None:
    status, printed, errors = node(*words, **environment)
    assert (status, printed, errors.count("\n")) == (2, "", 1)
    assert re.match(f"error: .*{parts}", errors), errors


def test_the_parameters_of_every_node_are_its_own_and_simulated_time_is_refused_while_it_runs() -> None:
    words = [word for row in PARAMETERS for word in ("-p", f"{row.name}:={str(row.default).lower()}")]
    status, printed, errors = node("-p", "height:=0.2", *words)
    assert (status, errors) == (0, "")
    assert printed.startswith("False True ")
    assert all(part in printed for part in ("read-only", "use_sim_time"))


ERRORS = {"TypeError": 1, "ImportError": 1, "InputError": 2}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("error", ERRORS)
def test_an_interrupt_that_becomes_another_error_ends_quietly(number: int, error: str) -> None:
    """As where Python formats an ImportError just then: `import ssl` of a server."""
    assert ended(TORN.format(error=error), str(int(number))) == (0, "", "")


@pytest.mark.parametrize(("error", "status"), ERRORS.items())
def test_an_error_without_an_interrupt_is_reported(error: str, status: int) -> None:
    found, _, errors = ended(TORN.format(error=error), str(int(signal.SIGWINCH)))  # which does nothing
    assert found == status
    assert ("Traceback" in errors) == (status == 1)
    assert errors.splitlines()[-1].endswith(": torn")


def test_simulated_time_with_a_clock_is_taken() -> None:
    """The node here has no timer of simulated time that would fire: it is stopped once it has begun."""
    with started(CLOCK) as clock:
        assert clock.stdout is not None
        assert clock.stdout.readline() == "ready\n"
        code = NODE.replace("self.create_timer(0.01, self.end)", "print('begun', flush=True)")
        with started(code, "--ros-args", "-p", "use_sim_time:=true") as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "begun\n"
            process.terminate()
            _, errors = process.communicate()
        clock.kill()
    assert (process.returncode, errors) == (0, "")


@pytest.mark.parametrize("status", [0, 2])
def test_the_process_ends_where_the_middleware_waits_for_ever(status: int) -> None:
    found, _, errors = ended(STUCK, str(status))
    assert found == status
    assert "Timeout" in errors
    assert '"<string>", line 7' in errors


def test_a_second_node_of_a_name_counts_once_it_stays_and_none_is_starting(monkeypatch: pytest.MonkeyPatch) -> None:
    transient = 0.05
    monkeypatch.setattr(single_instance, "_TRANSIENT", transient)
    with closing(Spun("own")) as spun:
        assert not single_instance.started_twice(spun.node)
        with single_instance.starting():  # it may take long until it is refused
            second = spun.add(Node("own", context=spun.context))
            spun.until(lambda: not single_instance.is_alone(spun.node))
            begun = time.monotonic()
            while time.monotonic() < begun + 5.0 * transient:
                assert not single_instance.started_twice(spun.node)
        spun.until(lambda: single_instance.started_twice(spun.node))
        spun.added.remove(second)
        spun.executor.remove_node(second)
        second.destroy_node()
        spun.until(lambda: single_instance.is_alone(spun.node))
        assert not single_instance.started_twice(spun.node)
