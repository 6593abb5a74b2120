# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator at the keyboard of a running stand: Enter and Ctrl-C, the real firmware on the emulated board."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from graph_runs import wait_until
from test_without_ros2 import WIRING, parameter_file

from atpid_control.stand.domain import own_domain
from atpid_driver.emulator import Emulator, missing_tools
from studies.watched_stand import Terminal

pytestmark = pytest.mark.slow


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Emulator]:
    if missing_tools() and not os.environ.get("CI"):
        pytest.skip("left out: the AVR tools are missing")
    eeprom = tmp_path / "eeprom"
    with Emulator(tmp_path / "board", eeprom=eeprom, height=0.02, bootloader=0.05, reset_on_open=True) as made:
        made.pace(1.0)
        yield made


@pytest.fixture
def stand(emulator: Emulator, root: Path, scenes: Path, tmp_path: Path) -> Iterator[Terminal]:
    labjack = parameter_file(tmp_path / "labjack.yaml", "labjack_node", **WIRING)
    serial = {"backend": "serial", "port": str(tmp_path / "board"), "lowest": 0.017, "highest": 1.0, "speed": 0.3}
    motor = parameter_file(tmp_path / "motor.yaml", "motor_node", **serial)
    with own_domain():
        made = Terminal(
            "atpid", "stand", scenes / "stand_realtime.yaml", "--bag", tmp_path / "bag",
            "--map", root / "atpid_control/config/maps/standard.npz", "--labjack-config", labjack,
            "--motor-config", motor,
        )  # fmt: skip
        yield made
        if made.status is None:
            os.kill(made.pid, signal.SIGTERM)
        made.end()


def off_after(emulator: Emulator, terminal: Terminal, key: str) -> float:
    """Type a key while the motor is on; return the time until it is off [s]."""
    wait_until(lambda: emulator.state().motor != 0)
    begun = emulator.state()
    terminal.type(key)
    wait_until(lambda: emulator.state().motor == 0)
    return (emulator.state().motor_off_ms - begun.ms) * 1e-3


@pytest.mark.timeout(300)
def test_enter_switches_the_motor_off_and_so_does_ctrl_c(stand: Terminal, emulator: Emulator, tmp_path: Path) -> None:
    wait_until(lambda: "Enter stops the motor" in stand.printed)
    wait_until(lambda: "[supervisor_node]: ready" in stand.printed)  # all nodes have loaded their libraries
    taken = off_after(emulator, stand, "\n")
    print(f"Enter: motor off after {taken * 1e3:.0f} ms")
    assert taken <= 0.22
    wait_until(lambda: "motor off" in stand.printed)
    stand.type("\x03")
    assert stand.end() == 0, stand.printed
    assert "Traceback" not in stand.printed
    assert yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
