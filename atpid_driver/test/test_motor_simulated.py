# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated ceiling: exact, deterministic, by time stamps alone; its settings, and its injected faults."""

from math import isnan, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.injected_faults import CEILING, KINDS, FaultError, Injected
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, NotReadyError, SettingsError
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits, Reading
from atpid_driver.motor.faults import (
    HEARTBEAT_TIME,
    NO_FAULT,
    WORDS,
    HeightRefusedError,
    LimitsError,
    MotorFault,
    in_words,
)
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import FaultyActuator, SimulatedActuator, Travel

LIMITS = Limits(lowest=0.017, highest=1.0, speed=0.3)
SECOND = 10**9
BLOCK = SECOND // 20
GOOD: dict[str, Any] = {"backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.3, "initial_height": 0.017}


def ready(height: float = 0.017) -> SimulatedActuator:
    ceiling = SimulatedActuator(LIMITS, height)
    ceiling.connect(0)
    ceiling.activate(0)
    return ceiling


def faulty(part: str, kind: str, begin: float, end: float) -> FaultyActuator:
    """Return a ceiling at 0.3 m with a fault from `begin` to `end` [s], armed."""
    ceiling = FaultyActuator(LIMITS, 0.3, [Injected(part, kind, begin, end)])
    ceiling.connect(0)
    ceiling.activate(0)
    return ceiling


def test_travels_at_constant_speed_and_arrives_exactly() -> None:
    ceiling = ready()
    ceiling.move(0.317, 5, SECOND)
    start, half, end = (ceiling.read(SECOND + part * SECOND // 2) for part in range(3))
    assert (start.mode, start.height, start.target, start.speed) == (Mode.MOVING, 0.017, 0.317, 0.3)
    assert (half.mode, half.velocity, half.target) == (Mode.MOVING, 0.3, 0.317)
    assert half.height == pytest.approx(0.167, abs=1e-15)
    assert (end.mode, end.height, end.velocity, end.sequence) == (Mode.HOLDING, 0.317, 0.0, 5)
    ceiling.move(0.617, 6, 2 * SECOND)
    ceiling.move(0.017, 7, 2 * SECOND + SECOND // 2)
    turned = ceiling.read(2 * SECOND + SECOND // 2)
    assert turned.height == pytest.approx(0.467, abs=1e-15)
    assert turned.velocity == -0.3
    assert ceiling.read(4 * SECOND).height == 0.017
    assert Travel(SECOND, 0.1, 0.2, 0.3).height(0) == 0.1, "before its start"


heights = st.floats(0.017, 1.0)
times = st.lists(st.integers(0, 20 * SECOND), min_size=1, max_size=20).map(sorted)


@given(heights, heights, times)
def test_reading_often_or_once_gives_the_same_heights(start: float, goal: float, instants: list[int]) -> None:
    often, once = ready(start), ready(start)
    often.move(goal, 1, 0)
    once.move(goal, 1, 0)
    assert [often.read(t).height for t in instants][-1] == once.read(instants[-1]).height


@pytest.mark.parametrize(
    "limits", [(0.0, 1.0, 0.3), (0.5, 0.5, 0.3), (0.1, float("inf"), 0.3), (0.1, 1.0, 0.0), (nan, 1, 1)]
)
def test_impossible_limits(limits: tuple[float, float, float]) -> None:
    with pytest.raises(LimitsError):
        Limits(*limits)


def test_a_ceiling_that_is_not_placed_is_homing_and_moves_nowhere() -> None:
    ceiling = ready(nan)
    state = ceiling.read(SECOND)
    assert (state.mode, state.homed, state.ready) == (Mode.HOMING, False, False)
    assert isnan(state.height)
    assert isnan(state.target)
    with pytest.raises(NotReadyError, match=r"0\.5 m"):
        ceiling.move(0.5, 1, SECOND)
    ceiling.place(0.29, SECOND)
    state = ceiling.read(2 * SECOND)
    assert (state.mode, state.height, state.target, state.sequence) == (Mode.HOLDING, 0.29, 0.29, 0)
    ceiling.move(0.59, 1, 2 * SECOND)
    assert ceiling.read(3 * SECOND).height == 0.59


def test_without_a_reference_no_height_can_be_commanded() -> None:
    ready_in = {mode for mode in Mode if Reading(mode, homed=True).ready}
    assert ready_in == {Mode.HOLDING, Mode.MOVING}
    assert not any(Reading(mode, homed=False).ready for mode in Mode)


def test_it_is_not_armed_before_it_is_connected() -> None:
    with pytest.raises(NotReadyError, match="connect"):
        SimulatedActuator(LIMITS, 0.2).activate(0)


def test_without_a_heartbeat_it_is_off_until_it_is_armed_again() -> None:
    """As the real one: 0.5 s after the last reading, wherever it was going; looking keeps it alive for no longer."""
    ceiling = ready()
    ceiling.move(0.9, 1, 0)
    ceiling.read(SECOND)
    for turn in range(10):
        assert ceiling.observe(SECOND + turn * BLOCK).mode is Mode.MOVING
    late = ceiling.observe(SECOND + HEARTBEAT_TIME + BLOCK)
    assert (late.mode, late.faults, late.ready) == (Mode.FAULT, MotorFault.HEARTBEAT, False)
    assert late.height == pytest.approx(0.017 + 0.3 * 1.5, abs=1e-12)
    with pytest.raises(NotReadyError):
        ceiling.move(0.9, 2, 2 * SECOND)
    ceiling.activate(3 * SECOND)
    armed = ceiling.read(4 * SECOND)
    assert (armed.mode, armed.faults, armed.height) == (Mode.HOLDING, NO_FAULT, late.height)


@pytest.mark.parametrize(
    ("change", "kind", "text"),
    [
        ({"backend": "hydraulic"}, SettingsError, "hydraulic.*simulated.*serial"),
        ({"backend": "serial"}, SettingsError, "port"),
        ({"backend": "serial", "port": "/dev/x", "lockstep": True}, SettingsError, "lockstep"),
        ({"rate": 0.0}, SettingsError, "rate.* 0 .* 10 to 200 Hz"),
        ({"command_timeout": nan}, SettingsError, "command_timeout.*nan"),
        ({"lowest": 2.0}, SettingsError, r"lowest 2 m.*0 < lowest < highest"),
        ({"initial_height": 0.01}, HeightRefusedError, r"0\.01 m.*0\.017 to 1 m"),
        ({"backend": "serial", "port": "/dev/x", "faults": ["motor off 1 2"]}, SettingsError, "faults.*serial.*none"),
        ({"faults": ["clock off 1 2"]}, FaultError, "clock.*height_sensor, motor"),
    ],
)
def test_bad_settings_are_refused(change: dict[str, Any], kind: type[Exception], text: str) -> None:
    with pytest.raises(kind, match=text):
        MotorSettings(**GOOD | change)


def test_every_fault_has_words() -> None:
    assert in_words(NO_FAULT) == ""
    assert len(in_words(~NO_FAULT).split("; ")) == len(MotorFault) == 18
    both = MotorFault.HEARTBEAT, MotorFault.STALL
    assert in_words(both[1] | both[0]) == "; ".join(WORDS[fault] for fault in both)


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


@pytest.mark.parametrize("part", CEILING)
@pytest.mark.parametrize("kind", KINDS)
def test_whatever_the_fault_the_ceiling_stays_in_its_range_and_a_person_arms_again(part: str, kind: str) -> None:
    """It moves up at 1.5 s; the checks of the firmware find the fault, which stays latched when its cause has gone."""
    ceiling, found = faulty(part, kind, 1.0, 4.0), NO_FAULT
    for block in range(1, 101):
        now = block * BLOCK
        try:
            ceiling.move(0.8 if now >= 1.5 * SECOND else 0.3, block, now)
        except DriverError:
            assert ceiling.read(now).mode is Mode.FAULT
        found = found or ceiling.read(now).faults
        assert LIMITS.lowest <= ceiling.true_height <= LIMITS.highest + 0.010
    expected = FOUND.get((part, kind), NO_FAULT)
    if expected is None:
        assert found == NO_FAULT
        assert ceiling.true_height == pytest.approx(0.8, abs=1e-3)
    elif expected:
        assert expected in found
        assert ceiling.read(101 * BLOCK).mode is Mode.FAULT
        ceiling.activate(102 * BLOCK)
        ceiling.move(0.5, 200, 102 * BLOCK)
        assert ceiling.read(160 * BLOCK).height == pytest.approx(0.5, abs=1e-3)


def test_a_broken_sensor_cannot_be_armed() -> None:
    ceiling = faulty("height_sensor", "off", 1.0, 40.0)
    assert ceiling.read(2 * SECOND).mode is Mode.FAULT
    with pytest.raises(DriverError, match=in_words(MotorFault.SENSOR_LOW)):
        ceiling.activate(3 * SECOND)


def test_before_its_fault_it_moves_as_the_simulated_one() -> None:
    ceilings: list[CeilingActuator] = [ready(0.3), faulty("motor", "off", 90.0, 91.0)]
    for block in range(1, 80):
        heights = []
        for ceiling in ceilings:
            ceiling.move(0.8 if block < 60 else 0.35, block, block * BLOCK)
            heights.append(ceiling.read(block * BLOCK).height)
        assert heights[0] == pytest.approx(heights[1], abs=LIMITS.speed * 1e-3 + 1e-9)


def test_a_clock_that_is_set_moves_nothing() -> None:
    ceiling = faulty("motor", "off", 90.0, 91.0)
    ceiling.move(0.8, 1, BLOCK)
    before = ceiling.read(2 * BLOCK).height
    assert ceiling.read(3600 * SECOND).height == before
    assert ceiling.read(BLOCK).height == before


def test_the_actuator_is_that_of_its_settings_and_opens_nothing() -> None:
    simulated, with_faults, serial = (
        actuator_of(MotorSettings(**GOOD | change))
        for change in ({}, {"faults": ["motor off 1 2"]}, {"backend": "serial", "port": "/dev/no-such-port"})
    )
    assert isinstance(simulated, SimulatedActuator)
    assert isinstance(with_faults, FaultyActuator)
    assert isinstance(serial, CeilingActuator)
