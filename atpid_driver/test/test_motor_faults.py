# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Injected faults of a simulated ceiling: what it does, which check finds them, and that a person arms it again."""

import math

import pytest

from atpid_common.injected_faults import CEILING, KINDS, FaultError, Injected
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, SettingsError
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits
from atpid_driver.motor.faults import MotorFault
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import SimulatedActuator
from atpid_driver.motor.simulated_faults import FaultyActuator

LIMITS = Limits(0.017, 1.0, 0.3)
BLOCK = 50_000_000
#: What each fault from 1 to 4 s is found as, while the ceiling goes from 0.3 to 0.8 m; None: it is not found.
FOUND = {
    ("height_sensor", "off"): MotorFault.SENSOR_LOW,
    ("height_sensor", "stuck"): MotorFault.STALL,
    ("height_sensor", "garbage"): MotorFault.SENSOR_JUMP,
    ("height_sensor", "wrong"): MotorFault.SENSOR_JUMP,
    ("height_sensor", "intermittent"): MotorFault.SENSOR_LOW,
    ("motor", "off"): MotorFault.STALL,
    ("motor", "wrong"): MotorFault.WRONG_WAY,
    ("motor", "slow"): MotorFault.OVERTIME,
    ("motor", "stuck"): MotorFault.UNCOMMANDED,
    ("motor", "delayed"): None,
}


def moved(part: str, kind: str) -> tuple[FaultyActuator, MotorFault]:
    """Move up at 1.5 s with the fault from 1 to 4 s; return the ceiling at 5 s and the first fault latched."""
    ceiling = FaultyActuator(LIMITS, 0.3, [Injected(part, kind, 1.0, 4.0)])
    ceiling.connect(0)
    ceiling.activate(0)
    found = MotorFault(0)
    for block in range(1, 101):
        now = block * BLOCK
        try:
            ceiling.move(0.8 if now >= 1_500_000_000 else 0.3, block, now)
        except DriverError:
            assert ceiling.read(now).mode is Mode.FAULT
        found = found or ceiling.read(now).faults
        assert LIMITS.lowest <= ceiling.true_height <= LIMITS.highest + 0.010
    return ceiling, found


@pytest.mark.parametrize(("part", "kind"), FOUND)
def test_the_check_of_the_firmware_finds_it_and_a_person_arms_again(part: str, kind: str) -> None:
    ceiling, found = moved(part, kind)
    expected = FOUND[part, kind]
    if expected is None:
        assert found == MotorFault(0)
        assert ceiling.true_height == pytest.approx(0.8, abs=1e-3)
        return
    assert expected in found
    assert ceiling.read(101 * BLOCK).mode is Mode.FAULT  # latched although the cause has gone
    ceiling.activate(102 * BLOCK)
    ceiling.move(0.5, 200, 102 * BLOCK)
    assert ceiling.read(160 * BLOCK).height == pytest.approx(0.5, abs=1e-3)


def test_a_broken_sensor_cannot_be_armed() -> None:
    ceiling = FaultyActuator(LIMITS, 0.3, [Injected("height_sensor", "off", 1.0, 40.0)])
    ceiling.connect(0)
    ceiling.activate(0)
    assert ceiling.read(2_000_000_000).mode is Mode.FAULT
    with pytest.raises(DriverError, match="not armed"):
        ceiling.activate(3_000_000_000)


def test_before_its_fault_it_moves_as_the_simulated_one() -> None:
    simulated: list[CeilingActuator] = [
        SimulatedActuator(LIMITS, 0.3), FaultyActuator(LIMITS, 0.3, [Injected("motor", "off", 90.0, 91.0)])
    ]  # fmt: skip
    for ceiling in simulated:
        ceiling.connect(0)
        ceiling.activate(0)
    for block in range(1, 80):
        heights = []
        for ceiling in simulated:
            ceiling.move(0.8 if block < 60 else 0.35, block, block * BLOCK)
            heights.append(ceiling.read(block * BLOCK).height)
        assert heights[0] == pytest.approx(heights[1], abs=LIMITS.speed * 1e-3 + 1e-9)


def test_a_clock_that_is_set_moves_nothing() -> None:
    ceiling = FaultyActuator(LIMITS, 0.3, [Injected("motor", "off", 90.0, 91.0)])
    ceiling.connect(0)
    ceiling.activate(0)
    ceiling.move(0.8, 1, BLOCK)
    before = ceiling.read(2 * BLOCK).height
    assert ceiling.read(3600 * 10**9).height == before
    assert ceiling.read(BLOCK).height == before


def test_a_real_motor_refuses_injected_faults() -> None:
    line = str(Injected("motor", "off", 1.0, 2.0))
    given = {"lowest": 0.017, "highest": 1.0, "speed": 0.3, "faults": [line]}
    assert isinstance(actuator_of(MotorSettings(backend="simulated", **given)), FaultyActuator)  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="allowed: none, a real motor is not disturbed"):
        MotorSettings(backend="serial", port="/dev/x", **given)  # type: ignore[arg-type]
    with pytest.raises(FaultError, match="which the simulated motor injects"):
        MotorSettings(backend="simulated", **(given | {"faults": ["clock off 1 2"]}))  # type: ignore[arg-type]


@pytest.mark.parametrize("part", CEILING)
@pytest.mark.parametrize("kind", KINDS)
def test_whatever_the_fault_the_ceiling_stays_between_grain_and_switch(part: str, kind: str) -> None:
    ceiling, _ = moved(part, kind)
    assert math.isfinite(ceiling.true_height)
