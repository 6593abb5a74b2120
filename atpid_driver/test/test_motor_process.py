# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node as a process, as `ros2 run` starts it: interrupted in motion, killed in motion, started twice."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from atpid_interfaces.msg import CeilingState
from motor_graph import Stand
from motor_rigs import SERIAL, board, need_emulator, wait_for

from atpid_driver.emulator import Emulator


def words(folder: Path) -> list[str]:
    parameters = SERIAL | {"port": folder / "board", "initial_height": 0.97}
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    return [sys.executable, "-m", "atpid_driver.nodes.motor_node", "--ros-args", *given]


@contextmanager
def started(folder: Path) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(words(folder), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def stand() -> Iterator[Stand]:
    need_emulator()
    made = Stand()
    yield made
    made.close()


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Emulator]:
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as made:
        made.pace(1.0)
        yield made


def start_down(stand: Stand) -> None:
    stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING)
    stand.until(
        lambda: stand.states[-1].mode == CeilingState.MOVING and stand.states[-1].target == 0.1,
        lambda: stand.command(0.1, 1.0),
    )


@pytest.mark.slow
@pytest.mark.parametrize("interrupts", [1, 2])
def test_ctrl_c_in_motion_stops_the_motor_at_once(
    stand: Stand, emulator: Emulator, tmp_path: Path, interrupts: int
) -> None:
    """Twice, as `ros2 launch` may send it."""
    with started(tmp_path) as process:
        start_down(stand)
        for _ in range(interrupts):
            process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=100.0)
        assert process.returncode == 0, output
        assert "Traceback" not in output
        wait_for(lambda: emulator.state().motor == 0, "motor off")
        truth = emulator.state()
        assert truth.motor_off_ms - truth.last_byte_ms < 50.0, "by its word, not by the heartbeat"


@pytest.mark.slow
def test_killed_in_motion_the_firmware_stops_the_motor(stand: Stand, emulator: Emulator, tmp_path: Path) -> None:
    with started(tmp_path) as process:
        start_down(stand)
        process.kill()
        wait_for(lambda: emulator.state().motor == 0, "motor off")
        truth = emulator.state()
        assert truth.motor_off_ms - truth.last_byte_ms <= 500.0


@pytest.mark.slow
def test_the_second_of_two_ends_with_one_line_and_the_first_goes_on(
    stand: Stand, emulator: Emulator, tmp_path: Path
) -> None:
    with started(tmp_path):
        start_down(stand)
        second = subprocess.Popen(words(tmp_path), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        # commanded all the while: a ceiling without commands is stopped, and the second may take long to start
        stand.until(lambda: second.poll() is not None, lambda: stand.command(0.1, 1.0))
        assert second.returncode == 2
        (line,) = second.communicate()[1].strip().splitlines()
        assert line.startswith("error: /motor_node is already running")
        stand.states.clear()
        stand.until(lambda: stand.states)
        assert stand.states[-1].mode in (CeilingState.MOVING, CeilingState.HOLDING)
        assert stand.states[-1].target == 0.1
