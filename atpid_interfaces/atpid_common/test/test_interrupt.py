# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""SIGINT, SIGTERM and SIGHUP while a process loads, works and ends."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from atpid_common.interrupt import Interrupt

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

SLOW_MODULE = """
import sys

class Torn:
    def __init__(self):
        print("loading", flush=True)
        sys.stdin.readline()
        while True:
            pass

    def __del__(self):
        raise AttributeError("half made")

try:
    Torn()
except KeyboardInterrupt:
    {reaction}
"""
MAIN = "import sys; from atpid_common.interrupt import run_executable; sys.exit(run_executable('slow_module'))"


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_stops_what_can_be_stopped(number: int) -> None:
    with pytest.raises(KeyboardInterrupt), Interrupt() as interrupt:
        os.kill(os.getpid(), number)
    assert interrupt.received


@pytest.mark.parametrize("number", SIGNALS)
def test_a_deferred_signal_is_only_noted(number: int) -> None:
    with Interrupt() as interrupt:
        interrupt.defer()
        assert not interrupt.received
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        assert interrupt.received


def test_the_former_handlers_come_back() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]
    with Interrupt():
        assert [signal.getsignal(number) for number in SIGNALS] != before
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupt() as interrupt:
            os.kill(os.getpid(), signal.SIGHUP)
        assert not interrupt.received
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("reaction", ["raise", "raise ImportError('not loaded')", "sys.exit(7)"])
@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupt_while_a_node_is_loaded_ends_quietly(tmp_path: Path, number: int, reaction: str) -> None:
    (tmp_path / "slow_module.py").write_text(SLOW_MODULE.format(reaction=reaction))
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stdout.readline() == "loading\n"
    process.stdin.write("\n")
    process.stdin.flush()
    process.send_signal(number)
    _, output = process.communicate(timeout=100.0)
    assert (process.returncode, output) == (0, "")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_came_before_python_had_started_ends_quietly(tmp_path: Path, number: int) -> None:
    """The launch files start nodes with these signals blocked."""
    (tmp_path / "slow_module.py").write_text("print('loaded')")
    start = f"import os, signal; os.kill(os.getpid(), {int(number)}); "
    done = subprocess.run(
        ["env", "--block-signal=INT", "--block-signal=TERM", "--block-signal=HUP", sys.executable, "-c", start + MAIN],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("number", SIGNALS)
def test_blocked_signals_arrive_once_there_is_a_handler(tmp_path: Path, number: int) -> None:
    (tmp_path / "slow_module.py").write_text(f"import os; os.kill(os.getpid(), {int(number)}); print('too far')")
    done = subprocess.run(
        ["env", "--block-signal=INT", "--block-signal=TERM", "--block-signal=HUP", sys.executable, "-c", MAIN],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_python_ends_changes_nothing(tmp_path: Path, number: int) -> None:
    module = f"import atexit, os\natexit.register(os.kill, os.getpid(), {int(number)})\ndef main(): return 3\n"
    (tmp_path / "slow_module.py").write_text(module)
    done = subprocess.run([sys.executable, "-c", MAIN], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (3, "")


def test_a_module_that_does_not_load_keeps_its_traceback(tmp_path: Path) -> None:
    (tmp_path / "slow_module.py").write_text("raise ImportError('broken')")
    done = subprocess.run([sys.executable, "-c", MAIN], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 1
    assert "ImportError: broken" in done.stderr


BURST = """
import sys
from atpid_common.interrupt import Interrupt
with Interrupt() as interrupt:
    interrupt.defer()
    print("ready", flush=True)
    sys.stdin.readline()
    print(interrupt.received, flush=True)
"""


def test_signals_that_interrupt_one_another_are_all_taken() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", BURST], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    for number in SIGNALS * 2000:
        process.send_signal(number)
    printed, output = process.communicate("\n", timeout=100.0)
    assert (process.returncode, printed, output) == (0, "True\n", "")


def test_a_node_whose_library_is_missing_names_it_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "needing.py").write_text("raise ModuleNotFoundError('none', name='rosbags')\n")
    command = "import sys; from atpid_common.interrupt import run_executable; sys.exit(run_executable('needing'))"
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: needs rosbags, which is not installed: pip install 'rosbags'\n"
