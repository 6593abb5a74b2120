# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small known motion: what moves as commanded passes however late it is read, and each thing wrong is named."""

from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.injected_faults import Injected
from atpid_common.vocabulary import Mode
from atpid_driver import SettingsError
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits, Reading
from atpid_driver.motor.known_motion import ANNOUNCED, KnownMotion, KnownMotionError
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import SimulatedActuator
from atpid_driver.motor.simulated_faults import FaultyActuator

LIMITS = Limits(lowest=0.017, highest=1.0, speed=0.3)
DISTANCE = 0.15
SECOND = 10**9


def armed(ceiling: CeilingActuator) -> CeilingActuator:
    ceiling.connect(0)
    ceiling.activate(0)
    return ceiling


def made(ceiling: CeilingActuator, limits: Limits = LIMITS, period: float = 0.02) -> tuple[list[float], float]:
    """Make the motion, read every `period` [s]; return the heights commanded and the time it took [s]."""
    motion, now, commanded = KnownMotion(DISTANCE, limits), 0, list[float]()
    assert "the ceiling moves from" in motion.announcement(ceiling.read(0).height, 0.0)
    while not motion.passed:
        assert motion.announcement(ceiling.read(now).height, now / SECOND) == "", "announced once"
        height = motion.turn(ceiling.read(now), now / SECOND)
        if not isnan(height):
            commanded.append(height)
            ceiling.move(height, 0, now)
        now += round(period * SECOND)
    return commanded, now / SECOND


@given(st.floats(0.017, 1.0), st.floats(0.001, 0.3))
def test_a_ceiling_that_moves_as_commanded_passes_from_anywhere_however_late_it_is_read(
    height: float, period: float
) -> None:
    ceiling = armed(SimulatedActuator(LIMITS, height))
    commanded, took = made(ceiling, period=period)
    away = height + DISTANCE if height + DISTANCE <= LIMITS.highest else height - DISTANCE
    assert commanded == [away, height]
    assert ceiling.read(round(took * SECOND)).height == height
    assert took >= ANNOUNCED + 2.0 * DISTANCE / LIMITS.speed


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (Injected("motor", "wrong", 0.0, 1e9), "the motor is off: .*against its command"),
        (Injected("motor", "off", 0.0, 1e9), "the motor is off: .*does not move"),
        (Injected("motor", "slow", 0.0, 1e9, 0.6), "expected 0.3 m/s within 25%, found at most 0.18"),
        (Injected("height_sensor", "slow", 0.0, 1e9, 0.3), "expected 0.3 m/s within 25%, found at most 0.2"),
    ],
)
def test_what_moves_otherwise_is_named(fault: Injected, found: str) -> None:
    ceiling = armed(FaultyActuator(LIMITS, 0.5, [fault]))
    with pytest.raises(KnownMotionError, match=f"known motion: commanded 0.500 to 0.650 m; .*{found}"):
        made(ceiling)


@pytest.mark.parametrize(("speed", "found"), [(0.2, "at least"), (0.45, "at most")])
def test_a_gain_that_is_wrong_shows_in_the_speed(speed: float, found: str) -> None:
    """A sensor or a motor whose gain is not the stand's: the height is reached, but not at the speed given."""
    with pytest.raises(KnownMotionError, match=f"expected {speed:g} m/s within 25%, found {found} 0.[23]"):
        made(armed(SimulatedActuator(LIMITS, 0.5)), Limits(0.017, 1.0, speed))


def test_an_interrupted_motion_begins_again_where_it_began_first() -> None:
    ceiling, motion = armed(SimulatedActuator(LIMITS, 0.5)), KnownMotion(DISTANCE, LIMITS)
    motion.announcement(0.5, 0.0)
    ceiling.move(motion.turn(ceiling.read(SECOND), 1.0), 0, SECOND)
    ceiling.move(float("nan"), 0, SECOND + SECOND // 6)
    motion.restart()
    assert "from 0.500 to 0.650 m" in motion.announcement(ceiling.read(2 * SECOND).height, 2.0)
    commanded, now = [], 2 * SECOND
    while not motion.passed:
        height = motion.turn(ceiling.read(now), now / SECOND)
        if not isnan(height):
            commanded.append(height)
            ceiling.move(height, 0, now)
        now += SECOND // 50
    assert commanded == [0.5, 0.65, 0.5]


def test_a_ceiling_that_moves_the_other_way_is_named_at_once() -> None:
    """As a height sensor sees it that is connected the wrong way round."""
    motion, at_rest = KnownMotion(DISTANCE, LIMITS), Reading(Mode.HOLDING, homed=True, height=0.5, target=0.5)
    motion.announcement(0.5, 0.0)
    assert motion.turn(at_rest, ANNOUNCED) == 0.65
    with pytest.raises(KnownMotionError, match=r"expected \+0.150 m, found -0.004 m; swap the motor's leads"):
        motion.turn(Reading(Mode.MOVING, homed=True, height=0.496, target=0.65), ANNOUNCED + 0.02)


@pytest.mark.parametrize("distance", [-0.1, 0.05, 0.5, float("nan")])
def test_a_distance_that_cannot_be_judged_or_may_not_fit_is_refused(distance: float) -> None:
    with pytest.raises(SettingsError, match=r"check_move .* m: allowed 0 \(none\) or 0.09 to 0.4915 m"):
        MotorSettings(backend="simulated", lowest=0.017, highest=1.0, speed=0.3, check_move=distance)


def test_in_lockstep_it_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"check_move 0\.1 m in lockstep"):
        MotorSettings(backend="simulated", lowest=0.017, highest=1.0, speed=0.3, lockstep=True, check_move=0.1)
