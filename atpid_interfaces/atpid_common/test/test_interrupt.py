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
each_signal = pytest.mark.parametrize("number", SIGNALS)
BLOCKED = ("env", *(f"--block-signal={name}" for name in ("INT", "TERM", "HUP")))

SLOW_MODULE = """
import sys

class Torn:
    def __init__(self):
        print("ready", flush=True)
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


def ended(folder: Path, module: str, code: str = MAIN, before: tuple[str, ...] = ()) -> tuple[int, str, str]:
    (folder / "slow_module.py").write_text(module)
    done = subprocess.run([*before, sys.executable, "-c", code], capture_output=True, text=True, cwd=folder)
    return done.returncode, done.stdout, done.stderr


@each_signal
def test_a_signal_stops_what_can_be_stopped_and_the_former_handlers_come_back(number: int) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    with pytest.raises(KeyboardInterrupt), Interrupt() as interrupt:
        os.kill(os.getpid(), number)
    assert interrupt.received
    assert [signal.getsignal(each) for each in SIGNALS] == before


@each_signal
def test_a_deferred_signal_is_only_noted(number: int) -> None:
    with Interrupt() as interrupt:
        interrupt.defer()
        assert not interrupt.received
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        assert interrupt.received


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupt() as interrupt:
            os.kill(os.getpid(), signal.SIGHUP)
        assert not interrupt.received
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("reaction", ["raise", "raise ImportError('not loaded')", "sys.exit(7)"])
@each_signal
def test_an_interrupt_while_a_node_is_loaded_ends_quietly(tmp_path: Path, number: int, reaction: str) -> None:
    (tmp_path / "slow_module.py").write_text(SLOW_MODULE.format(reaction=reaction))
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.stdin.write("\n")
    process.stdin.flush()
    process.send_signal(number)
    _, output = process.communicate(timeout=100.0)
    assert (process.returncode, output) == (0, "")


@each_signal
def test_a_signal_that_came_before_there_was_a_handler_ends_quietly(tmp_path: Path, number: int) -> None:
    """The launch files start nodes with these signals blocked; it comes before Python's start, and before `main`."""
    sends = f"import os; os.kill(os.getpid(), {int(number)}); "
    assert ended(tmp_path, "print('loaded')", sends + MAIN, BLOCKED) == (0, "", "")
    assert ended(tmp_path, f"{sends}print('late')", MAIN, BLOCKED) == (0, "", "")


@each_signal
def test_a_signal_while_python_ends_changes_nothing(tmp_path: Path, number: int) -> None:
    module = f"import atexit, os\natexit.register(os.kill, os.getpid(), {int(number)})\ndef main(): return 3\n"
    assert ended(tmp_path, module) == (3, "", "")


def test_a_module_that_does_not_load_keeps_its_traceback(tmp_path: Path) -> None:
    status, _, errors = ended(tmp_path, "raise ImportError('broken')")
    assert status == 1
    assert errors.splitlines()[-1].startswith("ImportError: ")


def test_a_node_whose_library_is_missing_names_it_in_one_line(tmp_path: Path) -> None:
    status, out, errors = ended(tmp_path, "raise ModuleNotFoundError('none', name='rosbags')\n")
    assert (status, out) == (2, "")
    assert errors.startswith("error: ")
    assert errors.endswith(" 'rosbags'\n")
    assert errors.count("\n") == 1
