# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator's stop and arming: supervisor, motor node and real firmware; what is answered is what the board does."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingState, SupervisorState
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.operator_requests import OperatorRequests
from atpid_control.stand.domain import own_domain
from atpid_control.views.live.requests import read_request
from atpid_driver.emulator import Emulator, missing_tools

STOP_WORDS = "use the emergency stop"


class Desk:
    """The operator's own node; the supervisor needs its answers. Beside it board, motor node and supervisor."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor, self.node = TurnExecutor(context=self.context), Node("desk", context=self.context)
        self.executor.add_node(self.node)
        self.supervisor: list[tuple[float, SupervisorState]] = []
        self.ceiling: list[CeilingState] = []
        self.node.create_subscription(
            SupervisorState, "supervisor/state", lambda one: self.supervisor.append((time.monotonic(), one)), STATES
        )
        self.node.create_subscription(CeilingState, "ceiling/state", self.ceiling.append, STATES)
        self.requests = OperatorRequests(self.node, EventPublisher(self.node))
        self.answers: list[tuple[bool, str]] = []
        self.clients: dict[str, Client] = {}  # each costs time in every round of the executor

    @property
    def mode(self) -> int:
        """The motor's last mode."""
        return int(self.ceiling[-1].mode) if self.ceiling else CeilingState.UNCONFIGURED

    @property
    def permit(self) -> bool:
        """Whether the supervisor permits motion."""
        return bool(self.supervisor and self.supervisor[-1][1].permit)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, happened: Callable[[], object], limit: float = 150.0) -> None:
        """Spin until it has happened."""
        end = time.monotonic() + limit
        while not happened():
            assert time.monotonic() < end, f"it did not happen; mode {self.mode}, {self.supervisor[-1:]}"
            self.executor.spin_once(timeout_sec=0.02)

    def begin(self, name: str) -> Future:
        """Call a service; return what will be its answer."""
        if name not in self.clients:
            self.clients[name] = self.node.create_client(Trigger, name)
        client = self.clients[name]
        self.until(client.service_is_ready)
        return client.call_async(Trigger.Request())

    def call(self, name: str) -> tuple[bool, str]:
        """Call a service; return success and words, which are one line."""
        future = self.begin(name)
        self.until(future.done)
        answer = future.result()
        assert answer is not None
        assert len(answer.message.splitlines()) == 1
        return bool(answer.success), str(answer.message)

    def press(self, button: str) -> tuple[bool, str]:
        """Ask as the page does; return the only answer."""
        self.answers.clear()
        self.requests.do(read_request(f'{{"number": 1, "do": "{button}"}}'), self.answers.append)
        self.until(lambda: self.answers)
        states = len(self.supervisor)
        self.until(lambda: len(self.supervisor) > states + 20)  # another answer would have come meanwhile
        (answer,) = self.answers
        return answer

    def confirmed(self, ask: Callable[[], tuple[bool, str]]) -> str:
        """Ask until it is confirmed, which a busy machine does not do in time, or misses a beat; return the words."""
        end = time.monotonic() + 60.0
        while not (answer := ask())[0]:
            assert time.monotonic() < end, answer
        return answer[1]

    def arm(self) -> str:
        """Arm until it is; return the words."""
        return self.confirmed(lambda: self.call("supervisor_node/rearm"))


@pytest.fixture
def alone() -> Iterator[Desk]:
    """A desk in a graph without a stand."""
    with own_domain():
        made = Desk()
        yield made
        made.close()


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    """The desk of the stand that the tests share."""
    with own_domain():
        made = Desk()
        yield made
        made.close()


def started(stack: ExitStack, module: str, **parameters: Any) -> "subprocess.Popen[bytes]":
    """Start a node as a process of its own; it is killed in the end."""
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    process = subprocess.Popen([sys.executable, "-m", module, "--ros-args", *words], stdout=subprocess.DEVNULL)

    def end() -> None:
        process.kill()
        process.wait()

    stack.callback(end)
    return process


class Stand:
    """Board, motor node and supervisor."""

    def __init__(self, stack: ExitStack, folder: Path, desk: Desk) -> None:
        self.board = stack.enter_context(
            Emulator(folder / "board", eeprom=folder / "eeprom", height=0.99, bootloader=0.05, reset_on_open=True)
        )
        self.board.pace(1.0)
        motor = {"backend": "serial", "port": folder / "board", "lowest": 0.017, "highest": 1.0, "speed": 0.3}
        self.motor = started(
            stack, "atpid_driver.nodes.motor_node", supervised="true", supervision_timeout=5.0, **motor
        )
        supervised = {"nodes": "[motor_node, desk]", "needed": "[desk]", "answer_time": 10.0}
        # it never gives up a desk that does not spin between two tests
        started(stack, "atpid_control.nodes.supervisor_node", **supervised, give_up=0.0)
        desk.until(lambda: desk.permit)
        desk.until(lambda: desk.mode not in (CeilingState.UNCONFIGURED, CeilingState.HOMING))

    def hold(self, desk: Desk) -> None:
        """Undo what a test before has done, or has left where it failed; arm it where it is not."""
        self.board.set("stop", "ok")
        self.motor.send_signal(signal.SIGCONT)
        if not desk.permit or desk.mode != CeilingState.HOLDING:
            desk.arm()
        desk.until(lambda: desk.mode == CeilingState.HOLDING)

    @property
    def off(self) -> bool:
        """Whether the motor itself is off."""
        return bool(self.board.state().motor == 0)


@pytest.fixture(scope="module")
def started_stand(desk: Desk, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        pytest.skip(f"left out: the real firmware on the emulated board; missing {' '.join(missing_tools())}")
    with ExitStack() as stack:
        yield Stand(stack, tmp_path_factory.mktemp("stand"), desk)


@pytest.fixture
def stand(desk: Desk, started_stand: Stand) -> Stand:
    """The stand of all tests, which holds the ceiling."""
    started_stand.hold(desk)
    return started_stand


def stays_off(desk: Desk, stand: Stand) -> bool:
    """Whether nothing arms or moves for a while without a request."""
    before, states = stand.board.state(), len(desk.ceiling)
    desk.until(lambda: stand.board.state().ms > before.ms + 1000)
    after = stand.board.state()
    off = {CeilingState.DISARMED, CeilingState.FAULT, CeilingState.UNCONFIGURED}
    return after.switched == before.switched and {int(one.mode) for one in desk.ceiling[states:]} <= off


@pytest.mark.slow
def test_a_stop_is_confirmed_by_the_board_and_arming_it_again_reports_what_the_motor_does(
    desk: Desk, stand: Stand
) -> None:
    words = desk.confirmed(lambda: desk.call("supervisor_node/stop"))
    assert stand.off
    assert "motor off, confirmed" in words
    desk.until(lambda: not desk.permit)
    assert "supervisor_node/rearm" in words  # which is what arms it
    refused = desk.call("motor_node/rearm")
    assert not refused[0]
    assert desk.arm().startswith("armed; ")
    desk.until(lambda: desk.mode == CeilingState.HOLDING)
    words = desk.confirmed(lambda: desk.press("stop"))
    assert stand.off
    assert "Arm again" in words  # the name of the button
    assert desk.confirmed(lambda: desk.press("arm")).startswith("armed; ")


@pytest.mark.slow
@pytest.mark.parametrize("pressed", ["while it is stopped", "while it is armed"])
def test_with_the_emergency_stop_pressed_nothing_is_armed_then_or_later(desk: Desk, stand: Stand, pressed: str) -> None:
    if pressed == "while it is stopped":
        desk.confirmed(lambda: desk.call("supervisor_node/stop"))
    stand.board.set("stop", "open")
    desk.until(lambda: desk.ceiling[-1].fault)
    for _ in range(2):
        success, words = desk.press("arm")
        assert not success
        assert "emergency stop pressed" in words
        desk.until(lambda: not desk.permit)  # which an answer may overtake
    stand.board.set("stop", "ok")
    assert stays_off(desk, stand)
    assert desk.arm().startswith("armed; ")
    desk.until(lambda: desk.mode == CeilingState.HOLDING)


@pytest.mark.slow
def test_a_hung_motor_node_confirms_nothing_and_arms_nothing_when_it_goes_on(desk: Desk, stand: Stand) -> None:
    stand.motor.send_signal(signal.SIGSTOP)
    answer = desk.begin("supervisor_node/stop")
    desk.until(lambda: not desk.permit)  # at once, whatever the motor answers
    begun = len(desk.supervisor)
    assert not answer.done()
    desk.until(answer.done)
    found = answer.result()
    assert found is not None
    assert not found.success
    assert found.message.startswith("permission withdrawn; motor off not confirmed")
    assert found.message.endswith(STOP_WORDS)
    times = [at for at, _ in desk.supervisor[begun - 1 :]]
    assert max(b - a for a, b in pairwise(times)) < 1.0, "the supervisor goes on while it waits"
    success, words = desk.call("supervisor_node/rearm")
    assert (success, desk.permit) == (False, False)
    assert "motor_node does not answer" in words
    stand.motor.send_signal(signal.SIGCONT)
    desk.until(lambda: desk.ceiling[-1].mode in (CeilingState.DISARMED, CeilingState.FAULT))
    assert stays_off(desk, stand)
    desk.arm()


@pytest.mark.slow
def test_a_stop_while_it_is_being_armed_has_the_last_word(desk: Desk, stand: Stand) -> None:
    desk.confirmed(lambda: desk.call("supervisor_node/stop"))
    desk.until(lambda: not desk.permit)
    stand.motor.send_signal(signal.SIGSTOP)  # so that the motor's answer is still to come
    arming = desk.begin("supervisor_node/rearm")
    desk.until(lambda: desk.permit or arming.done())  # two services have no order among them
    stopping = desk.begin("supervisor_node/stop")
    states = len(desk.supervisor)
    desk.until(lambda: len(desk.supervisor) > states + 4)
    stand.motor.send_signal(signal.SIGCONT)
    desk.until(lambda: arming.done() and stopping.done())
    answered, permits, states = stand.board.state(), len(desk.supervisor), len(desk.ceiling)
    armed = arming.result()
    assert armed is not None
    assert not armed.success
    # past the states of before, which an answer may overtake
    desk.until(lambda: len(desk.supervisor) > permits + 5 and len(desk.ceiling) > states + 5)
    assert not desk.permit
    assert stays_off(desk, stand)
    assert stand.board.state().switched == answered.switched


@pytest.mark.slow
def test_a_dead_motor_node_is_named_and_no_motion_permitted(desk: Desk, stand: Stand) -> None:
    """The last test of the stand."""
    stand.motor.kill()
    stand.motor.wait()
    success, words = desk.call("supervisor_node/stop")
    assert not success
    assert STOP_WORDS in words
    for success, words in (desk.call("supervisor_node/rearm"), desk.press("arm")):
        assert not success
        assert "motor_node has ended" in words
        assert not desk.permit


@pytest.mark.parametrize(("agrees", "refused"), [("supervisor", "motor"), ("motor", "supervisor")])
def test_on_the_page_the_motors_own_answer_decides_and_is_the_only_one(alone: Desk, agrees: str, refused: str) -> None:
    """Two nodes with the services of motor and supervisor, one of which refuses."""

    def answering(success: bool, words: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = success, words
            return response

        return answer

    alone.node.create_service(Trigger, f"{agrees}_node/stop", answering(True, "motor off"))
    alone.node.create_service(Trigger, f"{refused}_node/stop", answering(False, "not confirmed: the board is silent"))
    clients = [alone.node.create_client(Trigger, f"{name}_node/stop") for name in (agrees, refused)]
    alone.until(lambda: all(client.service_is_ready() for client in clients))
    for button in ("stop", "disarm"):
        alone.answers.clear()
        alone.requests.do(read_request(f'{{"number": 1, "do": "{button}"}}'), alone.answers.append)
        alone.until(lambda: alone.answers)
        for _ in range(20):
            alone.executor.spin_once(timeout_sec=0.02)
        ((success, words),) = alone.answers
        assert success is (agrees == "motor")
        assert (STOP_WORDS in words and "the board is silent" in words) is (agrees == "supervisor")
