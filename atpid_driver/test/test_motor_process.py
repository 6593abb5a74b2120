# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node with the real firmware behind it, in this process and as `ros2 run` starts it: faults and stops."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from math import nan
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingState, Event
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from motor_graph import Stand, arguments, motor_process
from motor_rigs import SERIAL, running_board, words
from std_srvs.srv import Trigger

from atpid_common.testing import PATIENCE, repeated_after_a_halt, wait_for
from atpid_driver.emulator import Emulator
from atpid_driver.motor.faults import MotorFault, in_words

pytestmark = repeated_after_a_halt


@pytest.fixture
def stand() -> Iterator[Stand]:
    with closing(Stand()) as made:
        yield made


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Emulator]:
    with running_board(tmp_path) as made:
        yield made


@pytest.fixture
def parameters(tmp_path: Path) -> dict[str, Any]:
    return SERIAL | {"port": str(tmp_path / "board"), "initial_height": 0.97, "identify_timeout": 2.0}


# the node in this process


def test_waits_for_its_board_then_homes_and_answers_the_handshake_at_its_first_height(
    stand: Stand, tmp_path: Path, parameters: dict[str, Any], capfd: pytest.CaptureFixture[str]
) -> None:
    stand.motor(**parameters)
    assert stand.more_states(70) == {CeilingState.UNCONFIGURED}  # more than one attempt
    with running_board(tmp_path):
        stand.states.clear()
        stand.until(
            lambda: any(state.handshake for state in stand.states), lambda: stand.command(nan, 0.0, 0, handshake=True)
        )
        handshake = next(state for state in stand.states if state.handshake)
        assert (handshake.mode, handshake.homed) == (CeilingState.HOLDING, True)
        assert handshake.height == pytest.approx(0.97, abs=2e-3)
        stand.close_motor()
    assert capfd.readouterr().err.count(f"{tmp_path}/board ") == 1


def test_autostart_that_still_waits_does_nothing_once_a_person_has_activated_the_node(
    stand: Stand, tmp_path: Path, parameters: dict[str, Any]
) -> None:
    """It looks for its board once a second: meanwhile that has come, and a person has been faster."""
    stand.motor(**parameters)
    stand.until_mode(CeilingState.UNCONFIGURED)
    with running_board(tmp_path):
        stand.change(Transition.TRANSITION_CONFIGURE)
        stand.change(Transition.TRANSITION_ACTIVATE)
        stand.more_states(70)  # 1.4 s
        stand.until_at(0.97)
        stand.close_motor()


def test_interrupted_it_stays_off_under_fresh_commands_until_it_is_armed_again(
    stand: Stand, emulator: Emulator, parameters: dict[str, Any]
) -> None:
    stand.motor(**parameters)
    stand.until_at(0.97)

    def command() -> None:
        stand.command(0.9, 1.0, 5)

    emulator.do("unplug")
    stand.until_mode(CeilingState.UNCONFIGURED, command)
    emulator.do("plug")
    stand.until_mode(CeilingState.FAULT, command)
    before = emulator.state()
    stand.until(lambda: emulator.state().ms > before.ms + 800, command)
    assert (emulator.state().travel_um, emulator.state().switched) == (before.travel_um, before.switched)
    lost = in_words(MotorFault.LINK_LOST)
    assert lost in stand.state.fault
    assert stand.texts(Event.LINK)
    assert any(lost in text for text in stand.texts(Event.FAULT))
    answer = stand.trigger("rearm")
    assert answer.success, answer.message
    stand.until_mode(CeilingState.HOLDING)
    stand.until(lambda: stand.state.target == 0.9, command)
    stand.close_motor()


def test_a_stop_is_answered_with_the_boards_state(stand: Stand, emulator: Emulator, parameters: dict[str, Any]) -> None:
    """Motor off once the answer is there; not confirmed where the board is halted, until it answers again."""
    stand.motor(**parameters)
    stand.until_at(0.97)
    stand.until(lambda: emulator.state().motor != 0, lambda: stand.command(0.1, 1.0, 5))
    answer = stand.trigger("stop")
    assert emulator.state().motor == 0
    assert answer.success
    assert {"off", "motor_node/rearm"} <= words(answer.message)
    emulator.pace(0)
    answer = stand.trigger("stop")
    assert not answer.success
    assert {"off", "not", "confirmed", "emergency"} <= words(answer.message)
    emulator.pace(1.0)
    stand.until(lambda: stand.trigger("stop").success)
    stand.close_motor()


# as a process


def start(stand: Stand, emulator: Emulator) -> float:
    """Wait until the motor runs on its way to the further end; return the board's time then [ms]."""
    stand.until_mode(CeilingState.HOLDING)
    goal = 0.1 if stand.state.height > 0.5 else 0.95
    stand.until_moving(goal, lambda: stand.command(goal, 1.0))
    begun = emulator.state()
    assert begun.motor != 0
    return begun.ms


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_ctrl_c_in_motion_stops_the_motor_at_once(
    stand: Stand, emulator: Emulator, parameters: dict[str, Any], number: signal.Signals
) -> None:
    """Twice, as `ros2 launch` may send it. Where the node is killed the firmware stops the motor."""
    with motor_process(**parameters) as process:
        start(stand, emulator)
        process.send_signal(number)
        process.send_signal(number)
        output, _ = process.communicate(timeout=PATIENCE)
        killed = number == signal.SIGKILL
        assert process.returncode == (-signal.SIGKILL if killed else 0), output
        assert "Traceback" not in output
        wait_for(lambda: emulator.state().motor == 0, "motor off")
        truth = emulator.state()
        silence = truth.motor_off_ms - truth.last_byte_ms
        assert silence <= 500.0 if killed else silence < 50.0, "by its word, not by the heartbeat"


#: Within which time the motor is off: by the node's word, and by the heartbeat that the firmware misses [ms].
BY_WORD, BY_HEARTBEAT = 200.0, 500.0
#: What other programs may add [ms].
BUSY = 200.0


@pytest.mark.always("the motor's stop, by the board's own state")
@pytest.mark.wall_time
def test_the_motor_is_off_in_time(stand: Stand, emulator: Emulator, parameters: dict[str, Any]) -> None:
    """From the operator's stop on, for each way to stop; `-s` prints the times."""
    stop = stand.peer.create_client(Trigger, "motor_node/stop")
    change = stand.peer.create_client(ChangeState, "motor_node/change_state")
    deactivate = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    with motor_process(**parameters) as process:
        ways: dict[str, tuple[Callable[[], object], float]] = {
            "service ~/stop": (lambda: stop.call_async(Trigger.Request()), BY_WORD),
            "lifecycle deactivate": (lambda: change.call_async(deactivate), BY_WORD),
            "cable pulled": (lambda: emulator.do("unplug"), BY_HEARTBEAT),
            "host hung": (lambda: process.send_signal(signal.SIGSTOP), BY_HEARTBEAT),
            "Ctrl-C": (lambda: process.send_signal(signal.SIGINT), BY_WORD),
        }
        for way, (act, allowed) in ways.items():
            stand.until(lambda: stop.service_is_ready() and change.service_is_ready())
            begun = start(stand, emulator)
            act()
            stand.until(lambda: emulator.state().motor == 0)
            taken = emulator.state().motor_off_ms - begun
            print(f"{way}: motor off after {taken:.0f} ms, allowed {allowed:.0f} ms")
            assert taken <= allowed + BUSY, way
            if way == "Ctrl-C":
                output, _ = process.communicate(timeout=PATIENCE)
                assert process.returncode == 0, output
                assert "Traceback" not in output
                break
            if way == "cable pulled":
                emulator.do("plug")
            elif way == "host hung":
                process.send_signal(signal.SIGCONT)
            stand.until_mode(CeilingState.DISARMED if allowed == BY_WORD else CeilingState.FAULT)
            stand.until(lambda: stand.trigger("rearm").success)
            stand.states.clear()


def test_the_second_of_two_ends_with_one_line_and_the_first_goes_on(
    stand: Stand, emulator: Emulator, parameters: dict[str, Any]
) -> None:
    with motor_process(**parameters):
        start(stand, emulator)
        command = [sys.executable, "-m", "atpid_driver.nodes.motor_node", *arguments(**parameters)]
        second = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        # commanded all the while: a ceiling without commands is stopped, and the second may take long to start
        stand.until(lambda: second.poll() is not None, lambda: stand.command(0.1, 1.0))
        assert second.returncode == 2
        (line,) = second.communicate()[1].strip().splitlines()
        assert line.startswith("error: /motor_node ")
        assert stand.more_states(1) <= {CeilingState.MOVING, CeilingState.HOLDING}
        assert stand.state.target == 0.1
