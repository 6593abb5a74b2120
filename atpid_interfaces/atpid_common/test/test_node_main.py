# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every node that is a process of its own refuses at its start, in one line, and what may not change then."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

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
            print(result.successful, result.reason, self.get_clock().now().nanoseconds > 0)
            self.done.set_result(0)

sys.exit(run_node(Own))
"""
#: Is being made until it is given a line. It prints when another one of its name has stayed for 1 s, and ends with
#: status 0 once that is gone, with 2 where it gave way itself: after 0.2 s, a fiftieth of the usual time.
SLOW = """
import sys, time
from rclpy.node import Node
from rclpy.task import Future
from atpid_common.nodes import single_instance
from atpid_common.nodes.node_main import run_node

single_instance._TRANSIENT = 0.2

class Own(Node):
    def __init__(self):
        super().__init__("own")
        self.done, self.together = Future(), None
        sys.stdin.readline()
        self.create_timer(0.02, self.look)
        print("made", flush=True)

    def look(self):
        alone = single_instance.is_alone(self)
        if single_instance.started_twice(self):
            self.done.set_result(2)
        elif self.together is None:
            self.together = None if alone else time.monotonic()
        elif alone:
            self.done.set_result(0)
        elif time.monotonic() - self.together > 5 * single_instance._TRANSIENT:
            print("together", flush=True)
            self.together = float("inf")

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


def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the node to its end."""
    return subprocess.run(
        [sys.executable, "-c", NODE, "--ros-args", *words], capture_output=True, text=True, check=False,
        env=os.environ | environment,
    )  # fmt: skip


@pytest.mark.parametrize("domain", ["233", "-1", "lab"])
def test_a_domain_that_does_not_exist_is_refused(domain: str) -> None:
    done = run(ROS_DOMAIN_ID=domain)
    line = f"error: ROS_DOMAIN_ID: given '{domain}'; allowed: 0 to 232, or not set\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", line)


def test_a_mistyped_parameter_is_refused() -> None:
    done = run("-p", "hieght:=0.2")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(
        "error: parameter hieght of own: the node has none of this name; did you mean height?"
    )
    assert len(done.stderr.splitlines()) == 1


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
    raise {error}

sys.exit(run_node(make, []))
"""
ERRORS = ("TypeError('expected a message argument')", "ImportError('not loaded')", "InputError('needs a library')")


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_becomes_another_error_ends_quietly(number: int, error: str) -> None:
    """As where Python formats an ImportError just then: `import ssl` of a server."""
    command = [sys.executable, "-c", TORN.format(error=error), str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize(("error", "status"), [*zip(ERRORS, (1, 1, 2), strict=True)])
def test_an_error_without_an_interrupt_is_reported(error: str, status: int) -> None:
    command = [sys.executable, "-c", TORN.format(error=error), str(int(signal.SIGWINCH))]  # which does nothing
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert ("Traceback" in done.stderr) == (status == 1)
    assert error.split("'")[1] in done.stderr


def test_the_parameters_of_every_node_are_its_own() -> None:
    words = [word for row in PARAMETERS for word in ("-p", f"{row.name}:={str(row.default).lower()}")]
    assert run("-p", "height:=0.2", *words).returncode == 0


def test_simulated_time_is_refused_while_a_node_runs() -> None:
    done = run()
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "False Trying to set a read-only parameter: use_sim_time. True\n"


def test_simulated_time_without_a_clock_is_refused_at_the_start() -> None:
    done = run("-p", "use_sim_time:=true")
    assert (done.returncode, done.stdout) == (2, "")
    line = "error: parameter use_sim_time of own: given True, and nothing publishes /clock; "
    assert done.stderr.startswith(line)
    assert len(done.stderr.splitlines()) == 1


@pytest.fixture
def clock() -> Iterator[None]:
    """Something that publishes on /clock."""
    with subprocess.Popen([sys.executable, "-c", CLOCK], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
        process.kill()


@pytest.mark.usefixtures("clock")
def test_simulated_time_with_a_clock_is_taken() -> None:
    """The node here has no timer of simulated time that would fire: it is stopped once it has begun."""
    process = subprocess.Popen(
        [sys.executable, "-c", NODE.replace("self.create_timer(0.01, self.end)", "print('begun', flush=True)"),
         "--ros-args", "-p", "use_sim_time:=true"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.terminate()
        _, errors = process.communicate()
    assert (process.returncode, errors) == (0, "")


#: Leaves as one does whose middleware holds the interpreter's lock and waits for ever.
STUCK = """
import ctypes, sys
from atpid_common.nodes.leaving import leaving
with leaving(0, limit=5.0):
    pass
with leaving(int(sys.argv[1]), limit=0.1):
    ctypes.PyDLL(None).pause()
"""


@pytest.mark.parametrize("status", [0, 2])
def test_the_process_ends_where_the_middleware_waits_for_ever(status: int) -> None:
    done = subprocess.run([sys.executable, "-c", STUCK, str(status)], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert "Timeout" in done.stderr
    assert 'File "<string>", line 7' in done.stderr


def test_a_node_that_runs_stays_however_long_a_second_one_takes_to_be_refused() -> None:
    command, piped = [sys.executable, "-c", SLOW], subprocess.PIPE
    with subprocess.Popen(command, stdin=piped, stdout=piped, text=True) as first:
        try:
            assert first.stdin is not None
            assert first.stdout is not None
            first.stdin.write("\n")
            first.stdin.flush()
            assert first.stdout.readline() == "made\n"
            with subprocess.Popen(command, stdin=piped, stdout=piped, stderr=piped, text=True) as second:
                try:
                    assert first.stdout.readline() == "together\n"
                    _, errors = second.communicate("\n", timeout=100.0)
                finally:
                    second.kill()
            assert second.returncode == 2, errors
            assert "error: /own is already running in this ROS domain" in errors
            assert first.wait(100.0) == 0
        finally:
            first.kill()
