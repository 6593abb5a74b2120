# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin of all tests: a ROS domain of the session's own, checked message fields, no leftovers, settings.

Each package's pytest.ini and the repository's pyproject.toml load it by `-p atpid_common.testing`, so a package tested
alone is tested as in the whole repository.
"""

import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from atpid_common.middleware import claimed

# The same examples each time, and none too slow: the result must not depend on chance or on the load.
settings.register_profile("atpid", derandomize=True, deadline=None)
settings.register_profile("long", max_examples=10_000, deadline=None, derandomize=False)
settings.load_profile("atpid")

# Plugins of a ROS installation load themselves and do not fit the locked pytest.
_FOREIGN_PLUGINS: tuple[str, ...] = ("launch_testing", "launch_testing_ros_pytest_entrypoint", "launch_pytest")
_FOREIGN_PLUGINS += tuple(f"ament_{name}" for name in ("copyright", "flake8", "lint", "pep257", "xmllint"))
_WARNINGS = (
    "error",
    # protobuf, which nidaqmx's gRPC client is made with, warns about its own extension on Python 3.12 and 3.13
    "ignore:Type google._upb:DeprecationWarning",
)


def _slowness() -> float:
    """Return how many times its processor time a piece of work takes on the clock: what other processes take of it."""
    begun, needed = time.perf_counter(), 0.05
    used = time.thread_time()
    while time.thread_time() - used < needed:
        pass
    return max(1.0, (time.perf_counter() - begun) / needed)


#: Of this machine, now. What a test allows for scales with it, and is generous without: a busy machine fails no test.
SLOWNESS = _slowness()
PATIENCE = 50.0 * SLOWNESS  # how long a test waits for an event, an answer or the end of a process [s]
_TIMEOUT = 600.0 * SLOWNESS  # ends a test that hangs [s]


class Halts:
    """When this process last stood still for longer than `LIMIT`, since other processes had the machine."""

    LIMIT = 0.1  # a fifth of what the motor's firmware allows a host [s]

    def __init__(self) -> None:
        """Watch from now on."""
        self.last = self.begun = time.monotonic()  # `begun`: the test that runs
        threading.Thread(target=self._watch, name="session-halts", daemon=True).start()

    def _watch(self) -> None:
        while True:
            before = time.monotonic()
            time.sleep(0.02)
            if time.monotonic() - before > self.LIMIT:
                self.last = time.monotonic()

    def seen(self) -> bool:
        """Return whether there was one since the test began."""
        return self.last > self.begun


_HALTS = Halts()
#: For tests in which devices with a clock of their own wait for this process: a run in which it stood still shows
#: nothing and is made again. Repeats are counted in pytest's summary.
repeated_after_a_halt = pytest.mark.flaky(reruns=5, condition=_HALTS.seen)


def pytest_runtest_setup() -> None:
    """Remember when a test begins."""
    _HALTS.begun = time.monotonic()


def wait_for(
    condition: Callable[[], object],
    what: str = "an event",
    turn: Callable[[], object] = lambda: time.sleep(0.005),
    state: Callable[[], object] = lambda: "",
) -> None:
    """Call `turn` until `condition` holds; fail after `PATIENCE`, with the state there is then."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"waited {PATIENCE:g} s for {what}; there is: {state()}"
        turn()


def spin_until(executor: Any, condition: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
    """Turn a ROS executor until `condition` holds; call `act` before each turn."""

    def turn() -> None:
        act()
        executor.spin_once(timeout_sec=0.02)

    wait_for(condition, turn=turn)


_MARKERS = (
    "wall_time: judges the clock or the whole machine; `make test` runs it after the others, alone",
    "always(reason): `make test` runs it whatever it costs (tests/parts.py)",
)

# Threads and processes that may outlive a test, by the start of their name: "session-" is for fixtures wider than
# one test, the others belong to libraries.
_LASTING_THREADS = ("session-", "Profile", "IO loop", "TCP-Executor", "Dask-", "asyncio_", "pydevd_")
_LASTING_PROCESSES = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")


def test_every_file_has_its_notice(request: pytest.FixtureRequest) -> None:
    """Fail where ament_copyright does; skip where there is none. Each package's tests import it once."""
    linter = pytest.importorskip("ament_copyright.main", reason="no ament_lint here")
    assert linter.main(argv=[str(request.path.parents[1])]) == 0


def pytest_plugin_registered(manager: pytest.PytestPluginManager) -> None:
    """Keep the plugins of a ROS installation out; pytest calls this before it loads any of them."""
    for name in _FOREIGN_PLUGINS:
        manager.set_blocked(name)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Apply the settings that are the same for all packages."""
    for number in (signal.SIGHUP, signal.SIGINT):  # of which `nohup` and a background job let programs ignore one
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL if number == signal.SIGHUP else signal.default_int_handler)
    for line in _WARNINGS:
        config.addinivalue_line("filterwarnings", line)
    for line in _MARKERS:
        config.addinivalue_line("markers", line)
    if config.getoption("timeout", None) is None:
        config.option.timeout = _TIMEOUT


def pytest_sessionstart(session: pytest.Session) -> None:
    """Refuse a package without the repository around it: tests take scenes and recorded runs from there."""
    package = session.config.rootpath
    if (package / "package.xml").is_file() and not any((folder / "scenes").is_dir() for folder in package.parents[:2]):
        pytest.exit(f"{package.name} is tested inside the repository, whose scenes/ and bags/ its tests use", 4)


def pytest_unconfigure() -> None:
    """Release the session's ROS domain."""
    _DOMAIN_HOLDER.close()


_RANDOM = random.Random(os.getpid())


def _claim_domain() -> tuple[int, socket.socket]:
    """Return a ROS domain that no other session on this machine uses, and the socket that keeps it for this session.

    Domain d has its ports from 7400 + 250 d on; up to 101 they lie below the system's own ephemeral ports. The socket's
    name is the one a bench claims its domain by, so benches and test sessions do not share one.
    """
    for domain in _RANDOM.sample(range(1, 102), 101):
        holder = claimed(f"bench/domain/{domain}")
        if holder is None:
            continue
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("", 7410 + 250 * domain))
            return domain, holder
        holder.close()
    raise RuntimeError("no free ROS domain between 1 and 101: end the ROS programs that run here")


# Before anything imports rclpy, and for every process a test starts.
_DOMAIN, _DOMAIN_HOLDER = _claim_domain()
os.environ["ROS_DOMAIN_ID"] = str(_DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"


@contextmanager
def own_domain() -> Iterator[None]:
    """Give what is started meanwhile a ROS domain of its own.

    On a busy machine a node of an earlier test has stayed in the graph of another participant, for six minutes.
    """
    domain, holder = _claim_domain()
    with closing(holder), pytest.MonkeyPatch.context() as change:
        change.setenv("ROS_DOMAIN_ID", str(domain))
        yield


def children() -> dict[int, str]:
    """Return this process's children that still run, with their command lines."""
    found, own = {}, os.getpid()
    # by the parent of every process: /proc/PID/task/TID/children may leave out some while others end
    for process in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError), open(f"/proc/{process}/stat", "rb") as stat:  # it ended just now
            state, parent = stat.read().rpartition(b")")[2].split()[:2]
            if int(parent) == own and state != b"Z":
                command = Path(f"/proc/{process}/cmdline").read_text(errors="replace")
                found[int(process)] = command.replace("\0", " ").strip()
    return {pid: command for pid, command in found.items() if not any(name in command for name in _LASTING_PROCESSES)}


def threads() -> set[threading.Thread]:
    """Return the threads that run, without those a library keeps for the session."""
    return {thread for thread in threading.enumerate() if not thread.name.startswith(_LASTING_THREADS)}


def leftovers(threads_before: set[threading.Thread], children_before: dict[int, str]) -> list[str]:
    """Wait for what a test started to end, and describe what does not."""
    deadline = time.monotonic() + PATIENCE
    for thread in threads() - threads_before:
        thread.join(max(0.0, deadline - time.monotonic()))
    left = [f"thread {thread.name}" for thread in threads() - threads_before]
    pause = threading.Event()
    while (new := children().keys() - children_before.keys()) and time.monotonic() < deadline:
        pause.wait(0.02)
    return left + [f"process {pid}: {children().get(pid, 'ended late')}" for pid in new]


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, entries: str, **modules: str) -> None:
    """Let Python find a distribution: its entry points, as in entry_points.txt, and modules by their text."""
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    info = folder / "of_a_test-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: of_a_test\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(folder)


@pytest.fixture(autouse=True)
def nothing_is_left_running() -> Iterator[None]:
    """A test that leaves a thread or a process behind fails."""
    threads_before, children_before = threads(), children()
    yield
    left = leftovers(threads_before, children_before)
    assert not left, "the test left running: " + "; ".join(left)
