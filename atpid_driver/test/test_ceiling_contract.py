# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every ceiling promises, by the simulated one and the firmware on the emulated board; the drive of a package."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from motor_rigs import running_board, settings

from atpid_common.testing import install, repeated_after_a_halt
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits
from atpid_driver.motor.contract import CeilingContract
from atpid_driver.motor.simulated import SimulatedActuator

pytestmark = repeated_after_a_halt


class TestSimulated(CeilingContract):
    """By time stamps alone."""

    now = 0

    def make(self) -> CeilingActuator:
        return SimulatedActuator(Limits(lowest=0.017, highest=1.0, speed=0.3), 0.9)

    def after(self, seconds: float) -> int:
        self.now += round(1e9 * seconds)
        return self.now


class TestSerial(CeilingContract):
    """With pyserial, and the firmware as it is on the board."""

    resolution = 1.6e-3

    @pytest.fixture(autouse=True)
    def board(self, tmp_path: Path) -> Iterator[None]:
        self.folder = tmp_path
        with running_board(tmp_path):
            yield

    def make(self) -> CeilingActuator:
        return actuator_of(settings(self.folder))


MADE = """
from atpid_driver import SettingsError
from atpid_driver.motor import MotorSettings, actuator_of
try:
    made = actuator_of(MotorSettings(backend="mine", lowest=0.017, highest=1.0, speed=0.3))
    print(made.limits.highest)
except SettingsError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("drive", "printed"),
    [
        ("from atpid_driver.motor.simulated import SimulatedActuator as S\nmake = lambda s: S(s.limits, 0.2)", "1.0"),
        ("make = lambda settings: object()", "backend mine (my_drive:make): lacks activate, close, connect,"),
        ("import no_such_library", "mine (my_drive:make of of_a_test 1.0), an entry point of the group atpid.drives:"),
    ],
)
def test_another_package_has_a_drive(drive: str, printed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "[atpid.drives]\nmine = my_drive:make\n", my_drive=drive)
    paths = f"{tmp_path}:{os.environ['PYTHONPATH']}"
    ran = subprocess.run(
        [sys.executable, "-c", MADE], env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=True
    )
    assert ran.stdout.startswith(printed)
