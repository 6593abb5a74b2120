# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated ceiling: exact, deterministic, by time stamps alone."""

from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor.ceiling_actuator import Limits, Reading
from atpid_driver.motor.errors import HeightRefusedError, LimitsError
from atpid_driver.motor.faults import HEARTBEAT_TIME, NO_FAULT, MotorFault
from atpid_driver.motor.simulated import SimulatedActuator, Travel

LIMITS = Limits(lowest=0.017, highest=1.0, speed=0.3)
SECOND = 10**9


def ready(height: float = 0.017) -> SimulatedActuator:
    ceiling = SimulatedActuator(LIMITS, height)
    ceiling.connect(0)
    ceiling.activate(0)
    return ceiling


def test_travels_at_constant_speed_and_arrives_exactly() -> None:
    ceiling = ready()
    ceiling.move(0.317, 5, SECOND)
    half, end = ceiling.read(SECOND + SECOND // 2), ceiling.read(2 * SECOND)
    assert (half.mode, half.velocity, half.target) == (Mode.MOVING, 0.3, 0.317)
    assert half.height == pytest.approx(0.167, abs=1e-15)
    assert (end.mode, end.height, end.velocity, end.sequence) == (Mode.HOLDING, 0.317, 0.0, 5)


def test_state_at_the_command_has_the_height_and_the_next_motion() -> None:
    ceiling = ready()
    ceiling.move(0.5, 1, SECOND)
    state = ceiling.read(SECOND)
    assert (state.mode, state.height, state.target, state.speed) == (Mode.MOVING, 0.017, 0.5, 0.3)


def test_turns_round_where_it_is() -> None:
    ceiling = ready()
    ceiling.move(0.617, 1, 0)
    ceiling.move(0.017, 2, SECOND)
    assert ceiling.read(SECOND).height == pytest.approx(0.317, abs=1e-15)
    assert ceiling.read(SECOND).velocity == -0.3
    assert ceiling.read(2 * SECOND).height == 0.017


def test_nan_stops_and_stays() -> None:
    ceiling = ready()
    ceiling.move(0.617, 1, 0)
    ceiling.move(nan, 2, SECOND)
    later = ceiling.read(9 * SECOND)
    assert later.mode is Mode.HOLDING
    assert later.height == later.target == pytest.approx(0.317, abs=1e-15)


@pytest.mark.parametrize("height", [0.0169, 1.0001, 0.0, -1.0, float("inf"), float("-inf")])
def test_heights_outside_the_limits_are_refused_and_nothing_moves(height: float) -> None:
    ceiling = ready()
    with pytest.raises(HeightRefusedError, match=r"allowed 0\.017 to 1 m"):
        ceiling.move(height, 1, 0)
    assert ceiling.read(SECOND).height == 0.017
    assert ceiling.read(SECOND).sequence == 0


def test_does_not_move_before_it_is_activated_nor_after_it_is_deactivated() -> None:
    ceiling = SimulatedActuator(LIMITS, 0.2)
    for prepare in (lambda: None, lambda: ceiling.connect(0)):
        prepare()
        with pytest.raises(NotReadyError):
            ceiling.move(0.3, 1, 0)
    ceiling.activate(0)
    ceiling.move(0.5, 1, 0)
    ceiling.deactivate(SECOND // 2)
    state = ceiling.read(5 * SECOND)
    assert (state.mode, state.homed, isnan(state.target)) == (Mode.DISARMED, False, True)
    assert state.height == pytest.approx(0.35, abs=1e-15)


heights = st.floats(0.017, 1.0)
times = st.lists(st.integers(0, 20 * SECOND), min_size=1, max_size=20).map(sorted)


@given(heights, heights, times)
def test_reading_often_or_once_gives_the_same_heights(start: float, goal: float, instants: list[int]) -> None:
    often, once = ready(start), ready(start)
    often.move(goal, 1, 0)
    once.move(goal, 1, 0)
    assert [often.read(t).height for t in instants][-1] == once.read(instants[-1]).height


@given(heights, st.lists(st.tuples(st.integers(0, 5 * SECOND), st.one_of(heights, st.just(nan))), max_size=12))
def test_never_leaves_its_limits_and_never_exceeds_its_speed(start: float, plan: list[tuple[int, float]]) -> None:
    ceiling, now, last = ready(start), 0, start
    for sequence, (wait, goal) in enumerate(plan):
        now += wait
        here = ceiling.read(now).height
        assert LIMITS.lowest <= here <= LIMITS.highest
        assert abs(here - last) <= 0.3 * wait * 1e-9 + 1e-12
        ceiling.move(goal, sequence, now)
        last = here


def test_before_its_start_a_travel_is_at_its_origin() -> None:
    assert Travel(SECOND, 0.1, 0.2, 0.3).height(0) == 0.1


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
    with pytest.raises(NotReadyError, match="not known yet where the ceiling stands"):
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
    ceiling = SimulatedActuator(LIMITS, 0.2)
    with pytest.raises(NotReadyError, match="connect it before"):
        ceiling.activate(0)


def test_without_a_heartbeat_it_is_off_until_it_is_armed_again() -> None:
    """As the real one: 0.5 s after the last reading, wherever it was going; looking keeps it alive for no longer."""
    ceiling = ready()
    ceiling.move(0.9, 1, 0)
    ceiling.read(SECOND)
    for turn in range(10):
        assert ceiling.observe(SECOND + turn * SECOND // 20).mode is Mode.MOVING
    late = ceiling.observe(SECOND + HEARTBEAT_TIME + SECOND // 20)
    assert (late.mode, late.faults, late.ready) == (Mode.FAULT, MotorFault.HEARTBEAT, False)
    assert late.height == pytest.approx(0.017 + 0.3 * 1.5, abs=1e-12)
    with pytest.raises(NotReadyError):
        ceiling.move(0.9, 2, 2 * SECOND)
    ceiling.activate(3 * SECOND)
    armed = ceiling.read(4 * SECOND)
    assert (armed.mode, armed.faults, armed.height) == (Mode.HOLDING, NO_FAULT, late.height)
