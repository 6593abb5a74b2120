# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""No height from before an interruption moves the ceiling: the rule, and the motor node that it is for."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState
from hypothesis import given
from hypothesis import strategies as st
from lifecycle_msgs.msg import Transition
from motor_graph import SIMULATED, Stand

from atpid_driver.motor.freshness import Freshness

SECOND = 1_000_000_000
BLOCK = SECOND // 20
LONGER_THAN_THE_TIMEOUT = 0.7  # of commands [s]


@given(
    offset=st.integers(-(10**18), 10**18),
    ppm=st.integers(-200, 200),
    jitter=st.lists(st.integers(0, 20_000_000), min_size=100, max_size=100),
    held=st.integers(SECOND // 2, 20 * SECOND),
)
def test_what_waited_is_old_and_what_comes_in_time_is_not(offset: int, ppm: int, jitter: list[int], held: int) -> None:
    fresh, now = Freshness(), 0
    for k, late in enumerate(jitter):
        now = k * BLOCK + k * BLOCK * ppm // 1_000_000 + late
        assert fresh.age(k * BLOCK + offset, now) <= 0.021
    # those of the time in which the loop, or this node, stood still
    woken = now + held
    ages = [fresh.age(k * BLOCK + offset, woken) for k in range(len(jitter), len(jitter) + held // BLOCK)]
    assert ages[0] >= 0.98 * held / SECOND - 0.1
    assert all(later <= earlier for earlier, later in pairwise(ages))
    following = len(jitter) + held // BLOCK
    assert fresh.age(following * BLOCK + offset, woken + BLOCK) <= 0.15


def test_a_source_that_begins_anew_is_not_judged_by_the_one_before() -> None:
    fresh = Freshness()
    assert [fresh.age(stamp, stamp + 5) for stamp in (10, 20, 30)] == [0.0, 0.0, 0.0]
    assert fresh.age(20, 10 * SECOND) == 0.0, "its clock was set back"
    assert fresh.age(20 + SECOND, 16 * SECOND) == pytest.approx(5.0, abs=0.1), "and is judged again from then on"
    assert fresh.age(20 + 2 * SECOND, 30 * SECOND) > 10.0
    fresh.restart()
    assert fresh.age(20 + 3 * SECOND, 44 * SECOND) == 0.0, "its stamps may go on where those of the other were"


def test_a_clock_that_drifts_all_day_makes_no_command_old() -> None:
    fresh = Freshness()
    ages = [fresh.age(k * BLOCK, k * BLOCK + k * BLOCK // 5_000) for k in range(20 * 3600)]
    assert max(ages) < 1e-3, "200 ppm are 0.7 s in an hour"


def test_a_command_is_compared_with_the_time_the_motor_was_armed() -> None:
    fresh = Freshness()
    fresh.armed(10 * SECOND)
    assert fresh.before_armed(0.6, 10 * SECOND + SECOND // 2)
    assert not fresh.before_armed(0.4, 10 * SECOND + SECOND // 2)


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


@contextmanager
def process() -> Iterator[subprocess.Popen[str]]:
    words = [word for name, value in SIMULATED.items() for word in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-m", "atpid_driver.nodes.motor_node", "--ros-args", *words]
    made = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield made
    finally:
        made.kill()
        made.communicate()


def going_to(stand: Stand, height: float) -> bool:
    return bool(stand.states and stand.states[-1].mode == CeilingState.MOVING and stand.states[-1].target == height)


def refused(stand: Stand) -> bool:
    return any(event.kind == "refused" and "it waited" in event.text for event in stand.events)


@pytest.mark.slow
@pytest.mark.parametrize("hung", ["motor node", "what commands it"])
def test_after_standing_still_only_a_fresh_height_moves_it(stand: Stand, hung: str) -> None:
    with process() as motor:
        stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING)
        stand.until(lambda: going_to(stand, 0.1), lambda: stand.command(0.1, time.time()))
        stand.until(lambda: stand.states[-1].mode == CeilingState.HOLDING, lambda: stand.command(0.1, time.time()))
        stand.events.clear()
        before = time.time()
        if hung == "motor node":
            motor.send_signal(signal.SIGSTOP)
            stand.command(0.9, before)
        stand.until(lambda: time.time() - before > LONGER_THAN_THE_TIMEOUT)
        if hung == "motor node":
            motor.send_signal(signal.SIGCONT)
        else:
            for k in range(5):
                stand.command(0.9, before + 0.01 * k)
        stand.until(lambda: refused(stand))
        assert stand.states[-1].target == pytest.approx(0.1)
        stand.until(lambda: going_to(stand, 0.8), lambda: stand.command(0.8, time.time()))
        assert not any(state.target == 0.9 for state in stand.states)


def test_what_was_commanded_before_it_was_armed_does_not_move_it(stand: Stand) -> None:
    node = stand.motor(lockstep=False)
    stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING)
    assert stand.change(Transition.TRANSITION_DEACTIVATE)
    made = time.time_ns()
    assert stand.change(Transition.TRANSITION_ACTIVATE)
    # as it comes where it waited in the middleware
    node._on_command(CeilingCommand(height=0.5, sequence=2), {"source_timestamp": made})
    stand.until(lambda: any("before it was armed" in event.text for event in stand.events))
    assert not any(state.target == 0.5 for state in stand.states)
