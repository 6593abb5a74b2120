# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator's stop and arming: supervisor, motor node and real firmware; what is answered is what the board does."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingState, SupervisorState
from motor_rigs import need_emulator
from rclpy.client import Client
from rclpy.task import Future
from spun import Spun
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STATES
from atpid_common.testing import repeated_after_a_halt, wait_for
from atpid_control.nodes.live_node import OperatorRequests
from atpid_control.stand.domain import own_domain
from atpid_control.views.live.requests import read_request
from atpid_driver.emulator import Emulator

pytestmark = repeated_after_a_halt

#: Parts of what is answered: what the operator has to do then, the button on the page, and the board's fault.
STOP_WORDS, BUTTON, FAULT = "use the emergency stop", "Arm again", "emergency stop pressed"


class Desk(Spun):
    """The operator's own node; the supervisor needs its answers. Beside it board, motor node and supervisor."""

    def __init__(self) -> None:
        super().__init__("desk")
        self.supervisor: list[SupervisorState] = []
        self.ceiling: list[CeilingState] = []
        self.node.create_subscription(SupervisorState, "supervisor/state", self.supervisor.append, STATES)
        self.node.create_subscription(CeilingState, "ceiling/state", self.ceiling.append, STATES)
        self.requests = OperatorRequests(self.node, EventPublisher(self.node))
        self.clients: dict[str, Client] = {}  # each costs time in every round of the executor

    @property
    def mode(self) -> int:
        return int(self.ceiling[-1].mode) if self.ceiling else CeilingState.UNCONFIGURED

    @property
    def permit(self) -> bool:
        return bool(self.supervisor and self.supervisor[-1].permit)

    def begin(self, name: str) -> Future:
        if name not in self.clients:
            self.clients[name] = self.node.create_client(Trigger, name)
        client = self.clients[name]
        self.until(client.service_is_ready)
        return client.call_async(Trigger.Request())

    def answer(self, future: Future) -> tuple[bool, str]:
        """Return success and words of an answer, which are one line."""
        self.until(future.done)
        answer = future.result()
        assert answer is not None
        assert len(answer.message.splitlines()) == 1
        return bool(answer.success), str(answer.message)

    def asked(self, name: str) -> tuple[bool, str]:
        return self.answer(self.begin(name))

    def press(self, button: str, turns: int = 20) -> tuple[bool, str]:
        """Ask as the page does; return the only answer."""
        answers: list[tuple[bool, str]] = []
        self.requests.do(read_request(f'{{"number": 1, "do": "{button}"}}'), answers.append)
        self.until(lambda: answers)
        for _ in range(turns):  # another answer would come meanwhile
            self.executor.spin_once(timeout_sec=0.02)
        (answer,) = answers
        return answer

    def confirmed(self, ask: Callable[[], tuple[bool, str]]) -> str:
        """Ask until it is confirmed, which a busy machine does not do in time, or misses a beat; return the words."""
        answers: list[tuple[bool, str]] = []
        wait_for(lambda: answers and answers[-1][0], turn=lambda: answers.append(ask()), state=lambda: answers[-1])
        return answers[-1][1]

    def stop(self) -> str:
        return self.confirmed(lambda: self.asked("supervisor_node/stop"))

    def arm(self) -> None:
        self.confirmed(lambda: self.asked("supervisor_node/rearm"))
        self.until(lambda: self.mode == CeilingState.HOLDING)


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    with own_domain(), closing(Desk()) as made:
        yield made


def started(stack: ExitStack, module: str, **parameters: Any) -> "subprocess.Popen[bytes]":
    """Start a node as a process of its own; it is killed in the end."""
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    process = subprocess.Popen([sys.executable, "-m", module, "--ros-args", *words], stdout=subprocess.DEVNULL)
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


class Stand:
    def __init__(self, stack: ExitStack, folder: Path, desk: Desk) -> None:
        self.board = stack.enter_context(
            Emulator(folder / "board", eeprom=folder / "eeprom", height=0.99, bootloader=0.05, reset_on_open=True)
        )
        self.board.pace(1.0)
        motor = {"backend": "serial", "port": folder / "board", "lowest": 0.017, "highest": 1.0, "speed": 0.3}
        watched = {"supervised": "true", "supervision_timeout": 5.0}
        self.motor = started(stack, "atpid_driver.nodes.motor_node", **watched, **motor)
        supervised = {"nodes": "[motor_node, desk]", "needed": "[desk]", "answer_time": 10.0}
        # it never gives up a desk that does not spin between two tests
        started(stack, "atpid_control.nodes.supervisor_node", **supervised, give_up=0.0)
        desk.until(lambda: desk.permit)
        desk.until(lambda: desk.mode not in (CeilingState.UNCONFIGURED, CeilingState.HOMING))

    @property
    def off(self) -> bool:
        return bool(self.board.state().motor == 0)


@pytest.fixture(scope="module")
def started_stand(desk: Desk, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    need_emulator()
    with ExitStack() as stack:
        yield Stand(stack, tmp_path_factory.mktemp("stand"), desk)


@pytest.fixture
def stand(desk: Desk, started_stand: Stand) -> Stand:
    """The stand of all tests, which holds the ceiling whatever a test before has done, or has left where it failed."""
    started_stand.board.set("stop", "ok")
    started_stand.motor.send_signal(signal.SIGCONT)
    if not desk.permit or desk.mode != CeilingState.HOLDING:
        desk.arm()
    return started_stand


def stays_off(desk: Desk, stand: Stand) -> bool:
    """Whether nothing arms or moves for a while without a request."""
    before, states = stand.board.state(), len(desk.ceiling)
    desk.until(lambda: stand.board.state().ms > before.ms + 1000)
    after = stand.board.state()
    off = {CeilingState.DISARMED, CeilingState.FAULT, CeilingState.UNCONFIGURED}
    return after.switched == before.switched and {int(one.mode) for one in desk.ceiling[states:]} <= off


@pytest.mark.always("the operator's stop, by the board's own answer")
def test_a_stop_is_confirmed_by_the_board_and_arming_reports_what_the_motor_does(desk: Desk, stand: Stand) -> None:
    words = desk.stop()
    assert stand.off
    desk.until(lambda: not desk.permit)
    assert "supervisor_node/rearm" in words  # which is what arms it
    assert not desk.asked("motor_node/rearm")[0]
    desk.arm()
    words = desk.confirmed(lambda: desk.press("stop"))
    assert stand.off
    assert BUTTON in words
    assert desk.confirmed(lambda: desk.press("arm")).startswith("armed; ")


@pytest.mark.parametrize("pressed", ["while it is stopped", "while it is armed"])
def test_with_the_emergency_stop_pressed_nothing_is_armed_then_or_later(desk: Desk, stand: Stand, pressed: str) -> None:
    if pressed == "while it is stopped":
        desk.stop()
    stand.board.set("stop", "open")
    desk.until(lambda: desk.ceiling[-1].fault)
    for _ in range(2):
        success, words = desk.press("arm")
        assert (success, FAULT in words) == (False, True)
        desk.until(lambda: not desk.permit)  # which an answer may overtake
    stand.board.set("stop", "ok")
    assert stays_off(desk, stand)
    desk.arm()


def test_a_hung_motor_node_confirms_nothing_and_arms_nothing_when_it_goes_on(desk: Desk, stand: Stand) -> None:
    stand.motor.send_signal(signal.SIGSTOP)
    stopping = desk.begin("supervisor_node/stop")
    desk.until(lambda: not desk.permit)  # at once, whatever the motor answers
    begun = len(desk.supervisor)
    assert not stopping.done()
    success, words = desk.answer(stopping)
    assert (success, words.endswith(STOP_WORDS)) == (False, True)
    assert len(desk.supervisor) > begun + 5, "the supervisor goes on while it waits"
    success, words = desk.asked("supervisor_node/rearm")
    assert (success, desk.permit, "motor_node" in words) == (False, False, True)
    stand.motor.send_signal(signal.SIGCONT)
    desk.until(lambda: desk.ceiling[-1].mode in (CeilingState.DISARMED, CeilingState.FAULT))
    assert stays_off(desk, stand)
    desk.arm()


def test_a_dead_motor_node_is_named_and_no_motion_permitted(desk: Desk, stand: Stand) -> None:
    """The last test of the stand."""
    stand.motor.kill()
    stand.motor.wait()
    success, words = desk.asked("supervisor_node/stop")
    assert (success, STOP_WORDS in words) == (False, True)
    for success, words in (desk.asked("supervisor_node/rearm"), desk.press("arm")):
        assert (success, "motor_node" in words, desk.permit) == (False, True, False)


@pytest.mark.parametrize(("agrees", "refused"), [("supervisor", "motor"), ("motor", "supervisor")])
def test_on_the_page_the_motors_own_answer_decides_and_is_the_only_one(agrees: str, refused: str) -> None:
    """Two nodes with the services of motor and supervisor, one of which refuses, in a graph without a stand."""

    def answering(success: bool, words: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = success, words
            return response

        return answer

    with own_domain(), closing(Desk()) as alone:
        alone.node.create_service(Trigger, f"{agrees}_node/stop", answering(True, "off"))
        alone.node.create_service(Trigger, f"{refused}_node/stop", answering(False, "mute"))
        clients = [alone.node.create_client(Trigger, f"{name}_node/stop") for name in (agrees, refused)]
        alone.until(lambda: all(client.service_is_ready() for client in clients))
        for button in ("stop", "disarm"):
            success, words = alone.press(button)
            assert success is (agrees == "motor")
            assert (STOP_WORDS in words and "mute" in words) is (agrees == "supervisor")
