# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor node over real DDS, beside a motor node and one that answers because it spins."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    ExcitationCommand,
    ExcitationState,
    SampleBlock,
    SupervisorState,
)
from diagnostic_msgs.msg import KeyValue
from lifecycle_msgs.srv import GetState
from node_graph import NodeGraph
from rcl_interfaces.srv import GetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES, nanoseconds_of
from atpid_common.testing import repeated_after_a_halt
from atpid_control.nodes.live_node import OperatorRequests
from atpid_control.nodes.supervisor_node import SupervisorNode
from atpid_control.views.live.requests import read_request
from atpid_driver.nodes.motor_node import MotorNode
from atpid_exciter.nodes.excitation_node import ExcitationNode

pytestmark = repeated_after_a_halt

#: Longer than this process is suspended on a busy machine [s].
PATIENT = 10.0
SUPERVISED = {"supervised": True, "supervision_timeout": PATIENT, "command_timeout": PATIENT}
LIMITS = {"lowest": 0.017, "highest": 1.0, "speed": 0.3}
MOTOR = {"backend": "simulated", **LIMITS, "speed": 0.01, "initial_height": 0.017, **SUPERVISED}
BAND = {"lowest_frequency": 1.0, "highest_frequency": 20.0}
EXCITER = {"backend": "simulated", **BAND, "highest_amplitude": 0.02, "rise_time": 0.1, "stale_timeout": PATIENT}
EXCITER |= SUPERVISED


class Board:
    """In place of the motor node: its states are those that a test sets, and its services confirm what is asked."""

    def __init__(self, context: Context, mode: int) -> None:
        self.node = node = Node("motor_node", context=context, start_parameter_services=False)
        self.state, self.hung, self.asked = CeilingState(mode=mode), False, 0
        self.meanwhile: Client | None = None  # of a service that is called while it arms
        self.states = node.create_publisher(CeilingState, "ceiling/state", STATES)
        node.create_timer(0.02, self._publish)
        node.create_service(GetState, "~/get_state", lambda _, response: response)
        each = ReentrantCallbackGroup()
        node.create_service(GetParameters, "~/get_parameters", self._on_get_parameters, callback_group=each)
        node.create_service(Trigger, "~/stop", self._on_stop)
        node.create_service(Trigger, "~/rearm", self._on_rearm)

    def _publish(self) -> None:
        if not self.hung:
            self.state.header.stamp = self.node.get_clock().now().to_msg()
        self.states.publish(self.state)

    async def _on_get_parameters(self, request: Any, response: Any) -> Any:
        self.asked += 1
        if self.asked == 1:
            await Future()  # lost
        response.values = [Parameter(name, value=LIMITS[name]).get_parameter_value() for name in request.names]
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.state.mode, response.success = CeilingState.DISARMED, True
        return response

    async def _on_rearm(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.meanwhile:
            await self.meanwhile.call_async(Trigger.Request())
        self.state.mode, response.success = CeilingState.HOLDING, True
        return response


class Run(NodeGraph):
    """A supervisor, the nodes that it needs, and what a run publishes."""

    def __init__(self, *, excited: bool = False, board: int | None = None, **parameters: Any) -> None:
        """Begin; board: the mode of a `Board` in place of the motor node."""
        super().__init__()
        self.sequence = 0
        self.selector = self.add(Node("selector_node", context=self.context))
        nodes = ["selector_node", *(["motor_node", "excitation_node"] if excited else [])]
        given = {"nodes": nodes, "needed": nodes, "answer_time": PATIENT, "check_time": 0.0}
        self.supervisor = self.make(SupervisorNode, given | parameters)
        self.states = self.collect(SupervisorState, "supervisor/state")
        self.events = self.collect(Event, "events", 100)
        self.ceiling = self.collect(CeilingState, "ceiling/state")
        self.excited = self.collect(ExcitationState, "excitation/state")
        self.blocks = self.peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.commands = self.peer.create_publisher(CeilingCommand, "ceiling/command", 10)
        self.tones = self.peer.create_publisher(ExcitationCommand, "excitation/command", 10)
        self.page = OperatorRequests(self.peer, EventPublisher(self.peer))
        if board is None:
            self.make(MotorNode, MOTOR)
        else:
            self.board = Board(self.context, board)
            self.add(self.board.node)
        if excited:
            self.exciter = self.make(ExcitationNode, EXCITER)

    def kinds(self) -> set[tuple[str, int]]:
        return {(event.kind, event.severity) for event in self.events}

    def tone(self) -> None:
        command = ExcitationCommand(kind=ExcitationCommand.SINE, amplitude=0.01, frequency=5.0, sequence=self.sequence)
        command.header.stamp = self.peer.get_clock().now().to_msg()
        self.tones.publish(command)

    def shakes(self, unless: Callable[[], bool] = lambda: False) -> None:
        """Wait until the exciter follows a new command, or what is given happens."""
        self.sequence += 1
        del self.excited[:]
        running = ExcitationState.RUNNING
        self.until(lambda: unless() or (self.excited and self.excited[-1].mode == running), self.tone)

    def at_rest(self, *, new: bool = False) -> None:
        """Wait until it is off, and see that the same command, or a new one, brings nothing within a second."""
        self.sequence += new
        self.until(lambda: not self.excited[-1].amplitude, self.tone)
        seen = len(self.excited)
        self.until(lambda: len(self.excited) > seen + 20, self.tone)
        assert not any(state.amplitude for state in self.excited[seen:])

    def armed(self) -> None:
        """Arm motor and exciter, and let it shake; again where this machine halted a node, which stops both."""
        self.until(lambda: self.states)
        while not self._armed():
            pass

    def _armed(self) -> bool:
        """Do so once; return whether nothing has stopped it meanwhile."""
        self.until(lambda: not self.states[-1].stop, lambda: self.call("supervisor_node/rearm"))
        self.until(lambda: self.states[-1].stop or self.states[-1].state == SupervisorState.READY)
        self.until(lambda: self.states[-1].stop or self.call("excitation_node/rearm").success)
        on = (CeilingState.HOLDING, CeilingState.MOVING)
        self.until(lambda: self.states[-1].stop or (self.ceiling and self.ceiling[-1].mode in on))
        self.shakes(lambda: self.states[-1].stop)
        return not self.states[-1].stop

    def press(self, button: str) -> tuple[bool, str]:
        """Press a button of the live page; return its answer."""
        answers: list[tuple[bool, str]] = []
        self.page.do(read_request(f'{{"number": 1, "do": "{button}"}}'), answers.append)
        self.until(lambda: answers)
        return answers[0]

    def until(self, happened: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        due = 0.0

        def now_and_then() -> None:
            nonlocal due
            if time.monotonic() >= due:
                act()
                due = time.monotonic() + 0.05

        super().until(happened, now_and_then)

    def ready(self) -> None:
        self.until(lambda: self.states and self.states[-1].state == SupervisorState.READY)
        assert self.states[-1].permit

    def displacement(self, value: float) -> None:
        """Publish a block in which the beam is so far away [m]."""
        data = [value] * 5
        block = SampleBlock(rate=1000.0, channels=["beam_displacement"], units=["m"], skew=[0.0], data=data)
        self.blocks.publish(block)

    def stopped(self, *words: str) -> bool:
        """Whether the run is stopped, and the reason has these words."""
        state = self.states[-1]
        stopped = state.state == SupervisorState.SAFE and state.stop and not state.permit
        return bool(stopped and all(word in state.reason for word in words))


Start = Callable[..., Run]


@pytest.fixture
def start() -> Iterator[Start]:
    with ExitStack() as stack:
        yield lambda **given: stack.enter_context(closing(Run(**given)))


@pytest.fixture(scope="module")
def excited() -> Iterator[Run]:
    with closing(Run(excited=True)) as made:
        yield made


@pytest.fixture
def run(excited: Run) -> Run:
    """One with an exciter, which shakes."""
    excited.armed()
    return excited


def test_a_node_that_does_not_answer_withdraws_the_permission_until_it_does(start: Start) -> None:
    run = start(answer_time=0.4)
    run.until(lambda: run.states)
    assert run.states[0].state == SupervisorState.STARTING
    assert not run.states[0].permit
    run.ready()
    run.executor.remove_node(run.selector)
    run.until(lambda: run.states[-1].state == SupervisorState.FAULT and not run.states[-1].permit)
    run.until(lambda: any(e.kind == Event.STALE and e.text.startswith("selector_node ") for e in run.events))
    run.executor.add_node(run.selector)
    run.until(lambda: run.states[-1].permit)


def test_one_that_ends_the_run_is_named(start: Start) -> None:
    run = start(answer_time=0.4, give_up=0.6)
    run.ready()
    run.executor.remove_node(run.selector)
    run.until(run.supervisor.done.done)
    assert {"selector_node", "0.6"} <= set(run.supervisor.error.split())


def test_the_operators_stop_is_latched_until_a_rearm(run: Run) -> None:
    assert run.call("supervisor_node/stop").success
    run.until(lambda: run.stopped("operator"))
    before = len(run.states)
    run.until(lambda: len(run.states) > before + 10)
    assert run.stopped("operator")
    assert run.ceiling[-1].mode == CeilingState.DISARMED
    assert (Event.STOPPED, Event.ALARM) in run.kinds()
    assert run.call("supervisor_node/rearm").success
    run.until(lambda: run.states[-1].permit and not run.states[-1].stop)


def test_a_level_that_is_passed_stops_and_is_armed_again_only_below_it(start: Start) -> None:
    run = start(beam_displacement_abort=0.1)
    run.ready()
    run.until(lambda: run.stopped("beam_displacement"), lambda: run.displacement(-0.2))
    refused = run.call("supervisor_node/rearm")
    assert not refused.success
    assert "beam_displacement" in refused.message
    assert run.stopped("beam_displacement")
    latest = KeyValue(key="beam_displacement", value="0.05")
    run.until(lambda: any(latest in status.values for status in run.statuses), lambda: run.displacement(0.05))
    assert run.call("supervisor_node/rearm").success
    run.until(lambda: run.states[-1].permit)
    run.until(lambda: run.stopped("beam_displacement"), lambda: run.displacement(0.3))


def test_a_motor_that_is_on_for_too_long_is_stopped(start: Start) -> None:
    run = start(motor_on_time_abort=0.3, beam_displacement_warning=0.002)
    run.ready()
    command = CeilingCommand(height=0.9, sequence=1)
    run.until(lambda: run.stopped("motor_on_time"), lambda: run.commands.publish(command))
    run.until(lambda: run.ceiling[-1].mode == CeilingState.DISARMED)
    height, seen = run.ceiling[-1].height, len(run.ceiling)
    # which stops nothing
    run.until(lambda: (Event.LIMIT, Event.WARNING) in run.kinds(), lambda: run.displacement(0.003))
    run.until(lambda: len(run.ceiling) > seen + 20)
    assert {(state.mode, state.height) for state in run.ceiling[seen:]} == {(CeilingState.DISARMED, height)}
    assert (Event.ABORT, Event.ALARM) in run.kinds()


def test_a_loop_that_fails_its_check_is_stopped_and_ends(start: Start) -> None:
    run = start(check_time=0.5)
    run.ready()
    run.until(run.supervisor.done.done, lambda: run.displacement(math.nan))
    assert {"check:", "beam_displacement:", "0%"} <= set(run.supervisor.error.split())
    run.until(lambda: run.stopped("loop check"))


def test_the_motors_limits_are_asked_for_again_where_no_answer_came(start: Start, scenes: Path) -> None:
    run = start(excited=True, board=CeilingState.HOLDING, check_time=60.0, scene=str(scenes / "thesis_4_3.yaml"))
    run.ready()
    run.until(lambda: any("check passed" in e.text for e in run.events), lambda: run.displacement(0.001))


def test_its_end_withdraws_permission_and_awaits_that_all_know(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    run = start()
    run.ready()
    awaited: list[str] = []
    monkeypatch.setattr(Publisher, "wait_for_all_acked", lambda publisher, _limit: awaited.append(publisher.topic_name))
    run.supervisor.close()
    assert sorted(awaited) == ["/events", "/supervisor/state"]
    run.until(lambda: run.states[-1].state == SupervisorState.SHUTDOWN)
    assert not run.states[-1].permit


def test_a_motor_that_goes_off_stops_the_exciter_and_arming_the_motor_does_not_start_it(run: Run) -> None:
    assert run.call("motor_node/stop").success
    run.at_rest()
    assert run.stopped("motor", "off")
    assert not run.call("excitation_node/rearm").success, "the supervisor's stop comes first"
    assert not run.call("motor_node/rearm").success
    answer = run.call("supervisor_node/rearm")
    assert answer.success
    assert "excitation_node/rearm" in answer.message
    run.at_rest(new=True)  # the motor alone is armed
    assert run.call("excitation_node/rearm").success
    run.at_rest()  # armed since, but the command is older than that
    run.shakes()


def test_a_stop_lasts_until_every_drive_has_seen_it(run: Run) -> None:
    before = len(run.states)
    assert run.call("supervisor_node/stop").success
    assert run.call("supervisor_node/rearm").success
    stamps = [(nanoseconds_of(state.header.stamp) * 1e-9, state.permit) for state in run.states[before:]]
    stopped = next(at for at, permit in stamps if not permit)
    assert next(at for at, permit in stamps if permit and at > stopped) - stopped > 0.3
    run.at_rest()


def test_a_motor_that_is_armed_again_at_once_was_off(run: Run) -> None:
    clients = [run.peer.create_client(Trigger, name) for name in ("motor_node/stop", "motor_node/rearm")]
    run.until(lambda: all(client.service_is_ready() for client in clients))
    asked = [client.call_async(Trigger.Request()) for client in clients]
    run.until(lambda: all(one.done() for one in asked))
    run.at_rest()
    assert run.stopped("motor", "off")


def test_stop_and_page_answer_what_both_drives_confirm(run: Run) -> None:
    success, words = run.press("stop")
    seen = run.peer.get_clock().now().nanoseconds
    assert success
    confirmed = {tuple(part.split()[:3]) for part in words.split("; ")[::2]}  # in the order of the answers
    assert confirmed == {(name, "off,", "confirmed") for name in ("motor", "exciter")}
    run.until(lambda: nanoseconds_of(run.excited[-1].header.stamp) > seen)
    assert not any(state.amplitude for state in run.excited if nanoseconds_of(state.header.stamp) > seen)
    assert run.press("arm")[0]
    run.at_rest()
    assert run.press("arm_exciter")[0]
    run.shakes()
    # one that does not answer is not confirmed; the supervisor's state reaches it when it goes on
    run.executor.remove_node(run.exciter)
    answer = run.call("supervisor_node/stop")
    assert not answer.success
    assert {"exciter", "not", "confirmed", "emergency"} <= set(answer.message.split())
    run.executor.add_node(run.exciter)
    run.at_rest(new=True)


def test_a_motor_whose_board_does_not_answer_stops_the_exciter(start: Start) -> None:
    run = start(excited=True, board=CeilingState.HOLDING)
    run.armed()
    run.board.hung = True  # its last state is repeated with the stamp it had
    run.at_rest()
    assert run.stopped("answer", "board", "0.35")
    run.board.hung = False
    run.armed()
    run.board.state = CeilingState(mode=CeilingState.FAULT, fault="emergency stop", faults=2048)
    run.at_rest()
    assert run.stopped("motor", "off", "emergency")


def test_a_fault_of_a_motor_that_is_off_stops_the_exciter_too(start: Start) -> None:
    """Of one that was never armed, since its emergency stop is pressed: the exciter may not run either."""
    run = start(excited=True, board=CeilingState.DISARMED)
    run.ready()
    run.until(lambda: run.call("excitation_node/rearm").success)
    run.shakes()
    assert not run.states[-1].stop
    run.board.state = CeilingState(mode=CeilingState.FAULT, fault="emergency stop")
    run.at_rest()
    assert run.stopped("motor", "off", "emergency")


def test_a_stop_while_the_motor_is_being_armed_has_the_last_word(start: Start) -> None:
    run = start(excited=True, board=CeilingState.HOLDING)
    run.armed()
    assert run.call("supervisor_node/stop").success
    run.board.meanwhile = run.peer.create_client(Trigger, "supervisor_node/stop")
    run.until(run.board.meanwhile.service_is_ready)
    answer = run.call("supervisor_node/rearm")
    assert not answer.success
    assert {"meanwhile:", "operator"} <= set(answer.message.split())
    assert run.stopped("operator")
    run.at_rest(new=True)
    assert not run.states[-1].permit
