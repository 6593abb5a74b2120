# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every `CeilingActuator` must do: the simulated ceiling and the real firmware pass the same tests."""

import time
from collections.abc import Callable, Iterator
from math import isnan, nan
from pathlib import Path

import pytest
from motor_rigs import SERIAL, arm, board, need_emulator, settings, wait_for

from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Reading
from atpid_driver.motor.errors import HeightRefusedError
from atpid_driver.motor.settings import MotorSettings

RESOLUTION = 1.6e-3


class Rig:
    """An actuator on the steady clock, as the motor node has it."""

    def __init__(self, actuator: CeilingActuator) -> None:
        self.actuator = actuator

    def read(self) -> Reading:
        return self.actuator.read(time.monotonic_ns())

    def move(self, height: float, sequence: int = 1) -> None:
        self.actuator.move(height, sequence, time.monotonic_ns())

    def until(self, condition: Callable[[Reading], bool], what: str) -> Reading:
        wait_for(lambda: condition(self.read()), what)
        return self.read()

    def connect(self) -> None:
        assert self.actuator.connect(time.monotonic_ns()).name

    def activate(self) -> Reading:
        arm(self.actuator)
        return self.read()


@pytest.fixture(params=["simulated", "serial"])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    if request.param == "simulated":
        made = Rig(actuator_of(MotorSettings(**SERIAL | {"backend": "simulated", "initial_height": 0.99})))
        yield made
        made.actuator.close()
        return
    need_emulator()
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        made = Rig(actuator_of(settings(tmp_path)))
        yield made
        made.actuator.close()


@pytest.fixture
def ready(rig: Rig) -> Rig:
    rig.connect()
    rig.activate()
    return rig


def test_before_it_is_connected_it_is_unconfigured(rig: Rig) -> None:
    assert rig.read().mode is Mode.UNCONFIGURED
    with pytest.raises(NotReadyError):
        rig.move(0.5)


def test_connected_it_is_disarmed_and_does_not_move(rig: Rig) -> None:
    rig.connect()
    reading = rig.read()
    assert (reading.mode, reading.homed, reading.velocity) == (Mode.DISARMED, False, 0.0)
    with pytest.raises(NotReadyError):
        rig.move(0.5)


def test_activated_it_is_homed_and_holds(ready: Rig) -> None:
    reading = ready.read()
    assert (reading.mode, reading.homed, reading.faults, reading.speed) == (Mode.HOLDING, True, 0, 0.3)
    assert 0.98 < reading.height <= 1.0 + RESOLUTION


@pytest.mark.slow
def test_it_travels_to_a_height_at_its_speed(ready: Rig) -> None:
    start = ready.read().height
    ready.move(0.9, sequence=4)
    moving = ready.until(lambda reading: reading.mode is Mode.MOVING, "moving")
    assert (moving.target, moving.velocity) == (0.9, -0.3)
    assert moving.height <= start + RESOLUTION
    there = ready.until(lambda reading: reading.mode is Mode.HOLDING, "arrived")
    assert there.height == pytest.approx(0.9, abs=RESOLUTION)
    assert (there.target, there.velocity, there.sequence) == (0.9, 0.0, 4)


def test_nan_stops_it_where_it_is(ready: Rig) -> None:
    ready.move(0.1)
    ready.until(lambda reading: reading.mode is Mode.MOVING, "moving")
    ready.move(nan, 2)
    there = ready.until(lambda reading: reading.mode is Mode.HOLDING, "stopped")
    assert there.height > 0.5
    assert there.target == pytest.approx(there.height, abs=2 * RESOLUTION)


@pytest.mark.slow
def test_a_new_height_on_the_way_turns_it_round(ready: Rig) -> None:
    ready.move(0.1)
    ready.until(lambda reading: reading.height < 0.95, "under way")
    ready.move(0.98, 2)
    there = ready.until(lambda reading: reading.mode is Mode.HOLDING and reading.sequence == 2, "arrived")
    assert there.height == pytest.approx(0.98, abs=RESOLUTION)


@pytest.mark.slow
@pytest.mark.parametrize("height", [0.0169, 1.01, -1.0, float("inf")])
def test_heights_outside_the_limits_are_refused(ready: Rig, height: float) -> None:
    before = ready.read()
    with pytest.raises(HeightRefusedError, match=r"allowed 0\.017 to 1 m"):
        ready.move(height)
    after = ready.read()
    assert (after.mode, after.sequence) == (Mode.HOLDING, before.sequence)
    assert after.height == pytest.approx(before.height, abs=RESOLUTION)


def test_deactivated_on_the_way_it_stops_at_once(ready: Rig) -> None:
    ready.move(0.1)
    ready.until(lambda reading: reading.mode is Mode.MOVING, "moving")
    ready.actuator.deactivate(time.monotonic_ns())
    reading = ready.read()
    assert (reading.mode, reading.velocity, isnan(reading.target)) == (Mode.DISARMED, 0.0, True)
    with pytest.raises(NotReadyError):
        ready.move(0.5)
    ready.activate()


def test_closed_it_is_unconfigured_and_can_be_connected_again(ready: Rig) -> None:
    ready.actuator.close()
    assert ready.read().mode is Mode.UNCONFIGURED
    ready.connect()
    assert ready.read().mode is Mode.DISARMED


def test_it_has_a_name_for_diagnostics_and_nothing_to_complain_of(ready: Rig) -> None:
    assert ready.actuator.health()["hardware_id"]
    assert ready.actuator.reports() == []
