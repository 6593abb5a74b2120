# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small known motion: what moves as commanded passes however late it is read, and each thing wrong is named."""

import re
from collections.abc import Callable, Iterator
from contextlib import closing
from math import isnan, nan
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingState, Event
from hypothesis import given
from hypothesis import strategies as st
from motor_graph import Stand
from motor_rigs import SERIAL, running_board, words

from atpid_common.errors import BAD_INPUT
from atpid_common.injected_faults import Injected
from atpid_common.testing import repeated_after_a_halt
from atpid_common.vocabulary import Mode
from atpid_driver import SettingsError
from atpid_driver.emulator import Emulator
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits, Reading
from atpid_driver.motor.faults import MotorFault, in_words
from atpid_driver.motor.known_motion import ANNOUNCED, KnownMotion, KnownMotionError
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import FaultyActuator, SimulatedActuator
from atpid_driver.nodes.motor_node import MotorNode

pytestmark = repeated_after_a_halt

LIMITS = Limits(lowest=0.017, highest=1.0, speed=0.3)
DISTANCE = 0.15
SECOND = 10**9
WRONG_WAY = re.escape(in_words(MotorFault.WRONG_WAY))


def armed(ceiling: CeilingActuator) -> CeilingActuator:
    ceiling.connect(0)
    ceiling.activate(0)
    return ceiling


def made(
    ceiling: CeilingActuator, motion: KnownMotion | None = None, period: float = 0.02, now: int = 0
) -> tuple[list[float], float]:
    """Make the motion from `now` [ns] on, read every `period` [s]; return the heights commanded and the end [s]."""
    motion, commanded = motion or KnownMotion(DISTANCE, LIMITS), list[float]()
    assert motion.announcement(ceiling.read(now).height, now / SECOND)
    while not motion.passed:
        assert motion.announcement(ceiling.read(now).height, now / SECOND) == "", "announced once"
        height = motion.turn(ceiling.read(now), now / SECOND)
        if not isnan(height):
            commanded.append(height)
            ceiling.move(height, 0, now)
        now += round(period * SECOND)
    return commanded, now / SECOND


@given(st.floats(0.017, 1.0), st.floats(0.001, 0.3))
def test_a_ceiling_that_moves_as_commanded_passes_however_late_it_is_read(height: float, period: float) -> None:
    ceiling = armed(SimulatedActuator(LIMITS, height))
    commanded, took = made(ceiling, period=period)
    away = height + DISTANCE if height + DISTANCE <= LIMITS.highest else height - DISTANCE
    assert commanded == [away, height]
    assert ceiling.read(round(took * SECOND)).height == height
    assert took >= ANNOUNCED + 2.0 * DISTANCE / LIMITS.speed


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (Injected("motor", "wrong", 0.0, 1e9), WRONG_WAY),
        (Injected("motor", "off", 0.0, 1e9), re.escape(in_words(MotorFault.STALL))),
        (Injected("motor", "slow", 0.0, 1e9, 0.6), "0.3 m/s .*25%.* at most 0.18"),
        (Injected("height_sensor", "slow", 0.0, 1e9, 0.3), "0.3 m/s .*25%.* at most 0.2"),
    ],
)
def test_what_moves_otherwise_is_named(fault: Injected, found: str) -> None:
    ceiling = armed(FaultyActuator(LIMITS, 0.5, [fault]))
    with pytest.raises(KnownMotionError, match=f"0.500 to 0.650 m; .*{found}"):
        made(ceiling)


@pytest.mark.parametrize(("speed", "found"), [(0.2, "least"), (0.45, "most")])
def test_a_gain_that_is_wrong_shows_in_the_speed(speed: float, found: str) -> None:
    """A sensor or a motor whose gain is not the stand's: the height is reached, but not at the speed given."""
    motion = KnownMotion(DISTANCE, Limits(0.017, 1.0, speed))
    with pytest.raises(KnownMotionError, match=f"{speed:g} m/s .*25%.* {found} 0.[23]"):
        made(armed(SimulatedActuator(LIMITS, 0.5)), motion)


def test_an_interrupted_motion_begins_again_where_it_began_first() -> None:
    ceiling, motion = armed(SimulatedActuator(LIMITS, 0.5)), KnownMotion(DISTANCE, LIMITS)
    first = motion.announcement(0.5, 0.0)
    ceiling.move(motion.turn(ceiling.read(SECOND), 1.0), 0, SECOND)
    ceiling.move(nan, 0, SECOND + SECOND // 6)
    motion.restart()
    assert motion.announcement(ceiling.read(2 * SECOND).height, 2.0) == first
    assert {"0.500", "0.650"} <= set(re.findall(r"[\d.]+", first))
    motion.restart()
    commanded, _ = made(ceiling, motion, now=2 * SECOND)
    assert commanded == [0.5, 0.65, 0.5]


def test_a_ceiling_that_moves_the_other_way_is_named_at_once() -> None:
    """As a height sensor sees it that is connected the wrong way round."""
    motion, at_rest = KnownMotion(DISTANCE, LIMITS), Reading(Mode.HOLDING, homed=True, height=0.5, target=0.5)
    motion.announcement(0.5, 0.0)
    assert motion.turn(at_rest, ANNOUNCED) == 0.65
    with pytest.raises(KnownMotionError, match=r"\+0\.150 m.* -0\.004 m"):
        motion.turn(Reading(Mode.MOVING, homed=True, height=0.496, target=0.65), ANNOUNCED + 0.02)


@pytest.mark.parametrize("distance", [-0.1, 0.05, 0.5, nan])
def test_a_distance_that_cannot_be_judged_or_may_not_fit_is_refused(distance: float) -> None:
    with pytest.raises(SettingsError, match=rf"check_move {distance:g} m.* 0 .*0\.09 to 0\.4915 m"):
        MotorSettings(backend="simulated", lowest=0.017, highest=1.0, speed=0.3, check_move=distance)
    with pytest.raises(SettingsError, match=r"check_move 0\.1 m.*lockstep"):
        MotorSettings(backend="simulated", lowest=0.017, highest=1.0, speed=0.3, lockstep=True, check_move=0.1)


# with the real firmware on the emulated board


@pytest.fixture
def stand() -> Iterator[Stand]:
    with closing(Stand()) as made:
        yield made


def run(stand: Stand, folder: Path, act: Callable[[Emulator], None]) -> MotorNode:
    """Ask for the handshake until it is answered or the node ends; act on the board once the motion is announced."""

    def ask() -> None:
        announced = [event for event in stand.events if event.text.startswith("known motion: in")]
        for event in announced:  # in a turn of its own: of two commands the node may see the last alone
            stand.events.remove(event)
            act(emulator)
        if not announced:
            stand.command(nan, 0.0, 0, handshake=True)

    def ended() -> bool:
        faults = sum(state.mode == CeilingState.FAULT for state in stand.states)  # for long: nothing more happens
        return node.done.done() or any(state.handshake for state in stand.states) or faults > 100

    with running_board(folder) as emulator:
        given: dict[str, Any] = {"port": str(folder / "board"), "initial_height": 0.97, "check_move": 0.1}
        node = stand.motor(**SERIAL | given)
        stand.until(ended, ask)
        if node.done.done():
            stand.until(lambda: stand.texts(Event.ABORT))
            before = emulator.state().travel_um
            stand.until(lambda: stand.state.mode in (CeilingState.DISARMED, CeilingState.FAULT))
            assert emulator.state().travel_um == pytest.approx(before, abs=10_000), "motor off"
        stand.close_motor()
    return node


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("speed", 300_000, ""),
        ("speed", 170_000, r"0\.3 m/s .*25%.* 0\.1"),
        ("swapped", 1, rf"-0\.100 m.* \+|{WRONG_WAY}"),  # found by the node or by the firmware
    ],
)
def test_the_firmware_moves_as_commanded_or_is_switched_off_and_the_node_ends(
    stand: Stand, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, value: int, found: str
) -> None:
    node = run(stand, tmp_path, lambda emulator: emulator.set(name, value))
    answered = [state.height for state in stand.states if state.handshake]
    assert node.done.done() is bool(found), node.error
    if found:
        assert answered == []
        assert node.done.result() == BAD_INPUT
        assert re.search(found, node.error)
        assert f"error: {node.error}\n" in capfd.readouterr().err
    else:
        assert answered[0] == pytest.approx(0.97, abs=2e-3), "afterwards"
        homed = [state.height for state in stand.states if state.homed]
        assert min(homed) == pytest.approx(0.87, abs=3e-3), "down: there is no room above"
        assert stand.events[-1].text.endswith("passed")


def test_a_height_commanded_before_it_ends_the_node(stand: Stand, tmp_path: Path) -> None:
    node = run(stand, tmp_path, lambda _: stand.command(0.5, 1.0, 1))
    assert node.done.done(), "passed"
    assert {"commanded", "before", "handshake"} <= words(node.error)
    assert min(state.height for state in stand.states if state.homed) > 0.95
