# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node with the real firmware behind it, over real DDS and real pyserial."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingState, Event
from lifecycle_msgs.msg import Transition
from motor_graph import Stand
from motor_rigs import SERIAL, board, need_emulator
from std_srvs.srv import Trigger

pytestmark = pytest.mark.slow


@pytest.fixture
def stand() -> Iterator[Stand]:
    need_emulator()
    made = Stand()
    yield made
    made.close()


def parameters(folder: Path, **change: Any) -> dict[str, Any]:
    return SERIAL | {"port": str(folder / "board"), "initial_height": 0.97, "identify_timeout": 2.0} | change


def kinds(stand: Stand) -> list[str]:
    return [event.kind for event in stand.events]


def refusals(stand: Stand, words: str) -> list[Event]:
    return [event for event in stand.events if event.kind == "refused" and words in event.text]


def in_mode(stand: Stand, mode: int) -> bool:
    return bool(stand.states) and bool(stand.states[-1].mode == mode)


def test_waits_for_its_board_then_homes_and_answers_the_handshake_at_its_first_height(
    stand: Stand, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stand.motor(**parameters(tmp_path))
    stand.until(lambda: len(stand.states) > 70)  # more than one attempt
    assert in_mode(stand, CeilingState.UNCONFIGURED)
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        stand.states.clear()
        stand.until(
            lambda: any(state.handshake for state in stand.states),
            lambda: stand.command(float("nan"), 0.0, 0, handshake=True),
        )
        handshake = next(state for state in stand.states if state.handshake)
        assert (handshake.mode, handshake.homed) == (CeilingState.HOLDING, True)
        assert handshake.height == pytest.approx(0.97, abs=2e-3)
        stand.close_motor()
    assert capfd.readouterr().err.count("is not there: board unplugged") == 1


@pytest.mark.parametrize(
    ("lose", "back", "words"),
    [
        ("unplug", "plug", "the connection to the board was lost while the motor was armed"),
        # by its watchdog or, where the node opens the port again before that, by the port
        ("hang", "state", "was restarted"),
    ],
)
def test_interrupted_it_stays_off_under_fresh_commands_until_it_is_armed_again(
    stand: Stand, tmp_path: Path, lose: str, back: str, words: str
) -> None:
    """As the bootloader of a real board, this one takes longer than the node waits before it opens the port again."""
    with board(tmp_path, height=0.99, bootloader=1.6, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        stand.motor(**parameters(tmp_path))
        stand.until_at(0.97)
        emulator.do(lose) if lose == "unplug" else emulator.command(lose)
        stand.until(lambda: in_mode(stand, CeilingState.UNCONFIGURED), lambda: stand.command(0.9, 1.0, 5))
        emulator.command(back)
        stand.until(lambda: in_mode(stand, CeilingState.FAULT), lambda: stand.command(0.9, 1.0, 5))
        before = emulator.state()
        stand.until(lambda: emulator.state().ms > before.ms + 1500, lambda: stand.command(0.9, 1.0, 5))
        assert (emulator.state().travel_um, emulator.state().switched) == (before.travel_um, before.switched)
        assert words in stand.states[-1].fault
        assert "link" in kinds(stand)
        assert any(event.kind == "fault" and words in event.text for event in stand.events)
        answer = stand.call(Trigger, "motor_node/rearm", Trigger.Request())
        assert answer.success, answer.message
        stand.until(
            lambda: in_mode(stand, CeilingState.HOLDING) and stand.states[-1].target == 0.9,
            lambda: stand.command(0.9, 1.0, 5),
        )
        stand.close_motor()


def test_autostart_that_still_waits_does_nothing_once_a_person_has_activated_the_node(
    stand: Stand, tmp_path: Path
) -> None:
    """It looks for its board once a second: meanwhile that has come, and a person has been faster."""
    stand.motor(**parameters(tmp_path))
    stand.until(lambda: in_mode(stand, CeilingState.UNCONFIGURED))
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        stand.change(Transition.TRANSITION_CONFIGURE)
        stand.change(Transition.TRANSITION_ACTIVATE)
        count = len(stand.states)
        stand.until(lambda: len(stand.states) > count + 100)  # 2 s
        stand.until_at(0.97)
        stand.close_motor()


def test_a_jam_is_reported_and_armed_again_on_request(stand: Stand, tmp_path: Path) -> None:
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        stand.motor(**parameters(tmp_path))
        stand.until_at(0.97)
        emulator.set("jam", 1)
        stand.until(lambda: in_mode(stand, CeilingState.FAULT), lambda: stand.command(0.5, 1.0, 2))
        assert stand.states[-1].fault.startswith("motor on but the ceiling does not move")
        stand.until(lambda: "fault" in kinds(stand))
        alarm = next(event for event in stand.events if event.kind == "fault")
        assert alarm.severity == Event.ALARM
        ramp = [0.5 + 0.01 * k for k in range(20)]
        stand.until(lambda: not ramp, lambda: stand.command(ramp.pop(0), 1.1, 3))
        # the height outside the limits is refused by itself, and after the ramp: its event ends the wait
        stand.until(lambda: refusals(stand, "9 m"), lambda: stand.command(9.0, 3.0, 4))
        assert len(refusals(stand, "does not move")) == 1
        emulator.set("jam", 0)
        answer = stand.call(Trigger, "motor_node/rearm", Trigger.Request())
        assert (answer.success, answer.message) == (True, "armed; homing if its height is lost")
        stand.until(lambda: in_mode(stand, CeilingState.HOLDING))
        stand.close_motor()


def test_a_stop_is_answered_with_the_boards_own_state(stand: Stand, tmp_path: Path) -> None:
    """Motor off once the answer is there; not confirmed where the board is halted, until it answers again."""
    with board(tmp_path, height=0.99, bootloader=0.05) as emulator:
        emulator.pace(1.0)
        stand.motor(**parameters(tmp_path))
        stand.until_at(0.97)
        stand.until(lambda: emulator.state().motor != 0, lambda: stand.command(0.1, 1.0, 5))
        answer = stand.call(Trigger, "motor_node/stop", Trigger.Request())
        assert emulator.state().motor == 0
        assert (answer.success, answer.message) == (True, "motor off; motor_node/rearm arms it again")
        emulator.pace(0)
        answer = stand.call(Trigger, "motor_node/stop", Trigger.Request())
        assert not answer.success
        assert answer.message.startswith("motor off not confirmed by the board: ")
        emulator.pace(1.0)
        stand.until(lambda: stand.call(Trigger, "motor_node/stop", Trigger.Request()).success)
        stand.close_motor()
