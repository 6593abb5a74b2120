# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every ceiling promises, by the simulated one and by the real firmware on the emulated board."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from motor_rigs import running_board, settings

from atpid_common.testing import repeated_after_a_halt
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
