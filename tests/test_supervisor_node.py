# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor node over real DDS, beside a motor node and one that answers because it spins."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    ExcitationCommand,
    ExcitationState,
    SampleBlock,
    SupervisorState,
)
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES, nanoseconds_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.operator_requests import OperatorRequests
from atpid_control.nodes.supervisor_node import SupervisorNode
from atpid_control.views.live.requests import read_request
from atpid_driver.nodes.excitation_node import ExcitationNode
from atpid_driver.nodes.motor_node import MotorNode

#: Longer than this process is suspended on a busy machine [s].
PATIENT = 5.0
#: Of what is waited for [s].
LIMIT = 40.0
MOTOR = {
    "backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.01, "initial_height": 0.017,
    "supervised": True, "supervision_timeout": PATIENT, "command_timeout": PATIENT,
}  # fmt: skip

EXCITER = {
    "backend": "simulated", "highest_amplitude": 0.02, "lowest_frequency": 1.0, "highest_frequency": 20.0,
    "rise_time": 0.1, "supervised": True, "supervision_timeout": PATIENT, "command_timeout": PATIENT,
    "stale_timeout": PATIENT,
}  # fmt: skip


class Run:
    """A supervisor, the node that it needs, and what a run publishes."""

    def __init__(self, *, excited: bool = False, **parameters: Any) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.selector, self.peer = (Node(name, context=self.context) for name in ("selector_node", "peer"))
        nodes = ["selector_node", *(["motor_node", "excitation_node"] if excited else [])]
        given = {"nodes": nodes, "needed": nodes, "answer_time": PATIENT, "check_time": 0.0}
        values = [Parameter(name, value=value) for name, value in (given | parameters).items()]
        self.supervisor = SupervisorNode(parameter_overrides=values, context=self.context)
        self.states: list[SupervisorState] = []
        self.events: list[Event] = []
        self.peer.create_subscription(SupervisorState, "supervisor/state", self.states.append, STATES)
        self.peer.create_subscription(Event, "events", self.events.append, 100)
        self.blocks = self.peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.commands = self.peer.create_publisher(CeilingCommand, "ceiling/command", 10)
        motor = [Parameter(name, value=value) for name, value in MOTOR.items()]
        self.motor = MotorNode(parameter_overrides=motor, context=self.context)
        self.nodes = [self.selector, self.peer, self.supervisor, self.motor]
        if excited:
            given_exciter = [Parameter(name, value=value) for name, value in EXCITER.items()]
            self.exciter = ExcitationNode(parameter_overrides=given_exciter, context=self.context)
            self.nodes.append(self.exciter)
            self.excited: list[ExcitationState] = []
            self.peer.create_subscription(ExcitationState, "excitation/state", self.excited.append, STATES)
            self.tones = self.peer.create_publisher(ExcitationCommand, "excitation/command", 10)
            self.page = OperatorRequests(self.peer, EventPublisher(self.peer))
        for node in self.nodes:
            self.executor.add_node(node)

    def tone(self, sequence: int) -> None:
        command = ExcitationCommand(kind=ExcitationCommand.SINE, amplitude=0.01, frequency=5.0, sequence=sequence)
        command.header.stamp = self.peer.get_clock().now().to_msg()
        self.tones.publish(command)

    def shakes(self, sequence: int) -> None:
        """Wait until the exciter follows a command."""
        self.until(
            lambda: self.excited and self.excited[-1].mode == ExcitationState.RUNNING, lambda: self.tone(sequence)
        )

    def at_rest(self, sequence: int) -> None:
        """Wait until it is off, and see that the same command does not bring it back within a second."""
        self.until(lambda: not self.excited[-1].amplitude, lambda: self.tone(sequence))
        seen = len(self.excited)
        self.until(lambda: len(self.excited) > seen + 20, lambda: self.tone(sequence))
        assert not any(state.amplitude for state in self.excited[seen:])

    def press(self, button: str) -> tuple[bool, str]:
        """Press a button of the live page; return its answer."""
        answers: list[tuple[bool, str]] = []
        self.page.do(read_request(f'{{"number": 1, "do": "{button}"}}'), answers.append)
        self.until(lambda: answers)
        return answers[0]

    def until(self, happened: Callable[[], object], act: Callable[[], None] = lambda: None) -> None:
        end, due = time.monotonic() + LIMIT, 0.0
        while not happened():
            assert time.monotonic() < end, f"it did not happen; {self.states[-1:]}"
            if time.monotonic() >= due:
                act()
                due = time.monotonic() + 0.05
            self.executor.spin_once(timeout_sec=0.02)

    def ready(self) -> None:
        self.until(lambda: self.states and self.states[-1].state == SupervisorState.READY)
        assert self.states[-1].permit

    def call(self, name: str, node: str = "supervisor_node") -> Any:
        client = self.peer.create_client(Trigger, f"{node}/{name}")
        self.until(client.service_is_ready)
        answer = client.call_async(Trigger.Request())
        self.until(answer.done)
        return answer.result()

    def displacement(self, value: float) -> None:
        """Publish a block in which the beam is so far away [m]."""
        data = [value] * 5
        block = SampleBlock(rate=1000.0, channels=["beam_displacement"], units=["m"], skew=[0.0], data=data)
        self.blocks.publish(block)

    def stopped(self, reason: str) -> bool:
        state = self.states[-1]
        return bool(state.state == SupervisorState.SAFE and state.stop and not state.permit and reason in state.reason)

    def close(self) -> None:
        self.supervisor.close()
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)


Start = Callable[..., Run]


@pytest.fixture
def start() -> Iterator[Start]:
    made: list[Run] = []

    def begin(**parameters: Any) -> Run:
        made.append(Run(**parameters))
        return made[-1]

    yield begin
    for run in made:
        run.close()


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
    assert run.supervisor.error == "selector_node has not answered for 0.6 s: the run ends"


def test_the_operators_stop_is_latched_until_a_rearm(start: Start) -> None:
    run = start()
    run.ready()
    assert run.call("stop").success
    run.until(lambda: run.stopped("stopped by the operator"))
    before = len(run.states)
    run.until(lambda: len(run.states) > before + 10)
    assert run.stopped("stopped by the operator")
    assert run.call("rearm").success
    run.until(lambda: run.states[-1].permit and not run.states[-1].stop)


def test_a_level_that_is_passed_stops_and_is_armed_again_only_below_it(start: Start) -> None:
    run = start(beam_displacement_abort=0.1)
    run.ready()
    run.until(lambda: run.stopped("beam_displacement"), lambda: run.displacement(-0.2))
    refused = run.call("rearm")
    assert (refused.success, refused.message) == (False, "not armed: beam_displacement: still above the abort level")
    assert run.stopped("beam_displacement")
    run.until(
        lambda: math.isclose(run.supervisor._quantities._latest["beam_displacement"], 0.05),
        lambda: run.displacement(0.05),
    )
    assert run.call("rearm").success
    run.until(lambda: run.states[-1].permit)
    run.until(lambda: run.stopped("beam_displacement"), lambda: run.displacement(0.3))


def test_a_motor_that_is_on_for_too_long_is_stopped(start: Start) -> None:
    run = start(motor_on_time_abort=0.3)
    run.ready()
    run.until(
        lambda: run.stopped("motor_on_time"), lambda: run.commands.publish(CeilingCommand(height=0.9, sequence=1))
    )


def test_a_loop_that_fails_its_check_is_stopped_and_ends(start: Start) -> None:
    run = start(check_time=0.5)
    run.ready()
    run.until(run.supervisor.done.done, lambda: run.displacement(math.nan))
    assert run.supervisor.error.startswith("loop check: beam_displacement: 0% of its readings are valid")
    run.until(lambda: run.stopped("loop check"))


def test_its_end_withdraws_the_permission(start: Start) -> None:
    run = start()
    run.ready()
    run.supervisor.close()
    run.until(lambda: run.states[-1].state == SupervisorState.SHUTDOWN)
    assert not run.states[-1].permit


def armed(run: Run) -> None:
    """Wait until motor and exciter are armed by themselves, and let the exciter shake."""
    run.ready()
    run.until(lambda: run.motor._active and run.exciter._active)
    run.shakes(1)


def test_a_motor_that_goes_off_stops_the_exciter_and_arming_the_motor_does_not_start_it(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    assert run.call("stop", "motor_node").success
    run.at_rest(1)
    assert run.stopped("motor off")
    assert not run.call("rearm", "excitation_node").success, "the supervisor's stop comes first"
    assert not run.call("rearm", "motor_node").success
    answer = run.call("rearm")
    assert answer.success
    assert "excitation_node/rearm arms the exciter" in answer.message
    run.at_rest(2)  # a new command, and the motor alone is armed
    assert run.call("rearm", "excitation_node").success
    run.at_rest(2)  # armed since, but older than that
    run.shakes(3)


def test_a_stop_lasts_until_every_drive_has_seen_it(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    before = len(run.states)
    assert run.call("stop").success
    assert run.call("rearm").success
    stamps = [(nanoseconds_of(state.header.stamp) * 1e-9, state.permit) for state in run.states[before:]]
    stopped = next(at for at, permit in stamps if not permit)
    assert next(at for at, permit in stamps if permit and at > stopped) - stopped > 0.3
    run.at_rest(1)


def test_a_motor_whose_board_does_not_answer_stops_the_exciter(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    run = start(excited=True)
    armed(run)
    stamp = run.motor.get_clock().now().to_msg()  # of the last state of a board that has hung
    monkeypatch.setattr(run.motor, "_stamp_of", lambda _reading: stamp)
    run.at_rest(1)
    assert run.stopped("no answer of the motor's board for 0.35 s")
    monkeypatch.undo()
    assert run.call("rearm").success
    assert run.call("rearm", "excitation_node").success
    run.shakes(2)


def test_a_motor_that_is_armed_again_at_once_was_off(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    clients = [run.peer.create_client(Trigger, name) for name in ("motor_node/stop", "motor_node/rearm")]
    run.until(lambda: all(client.service_is_ready() for client in clients))
    asked = [client.call_async(Trigger.Request()) for client in clients]
    run.until(lambda: all(one.done() for one in asked))
    run.at_rest(1)
    assert run.stopped("motor off")


def test_a_fault_of_the_motor_stops_the_exciter(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    state = CeilingState(mode=CeilingState.FAULT, fault="emergency stop", faults=2048)
    run.supervisor._on_state(state)  # the board's word, as the motor node passes it on
    run.at_rest(1)
    assert run.stopped("motor off: emergency stop")


def test_stop_and_page_answer_what_both_drives_confirm(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    success, words = run.press("stop")
    assert success
    assert "motor off, confirmed" in words
    assert "exciter off, confirmed" in words
    assert not run.exciter._drive.turn(time.monotonic_ns()).amplitude
    assert run.press("arm")[0]
    run.at_rest(1)
    assert run.press("arm_exciter")[0]
    run.shakes(2)
    # one that does not answer is not confirmed; the supervisor's state reaches it when it goes on
    run.executor.remove_node(run.exciter)
    answer = run.call("stop")
    assert not answer.success
    assert "exciter off not confirmed" in answer.message
    assert "use the emergency stop" in answer.message
    run.executor.add_node(run.exciter)
    run.at_rest(2)


def test_its_last_word_is_awaited(start: Start) -> None:
    run = start()
    run.ready()
    awaited: list[str] = []
    for publisher in (run.supervisor._events.publisher, run.supervisor._states):
        publisher.wait_for_all_acked = lambda _limit, name=publisher.topic_name: awaited.append(name)
    run.supervisor.close()
    assert sorted(awaited) == ["/events", "/supervisor/state"]


def test_a_fault_of_a_motor_that_is_off_stops_the_exciter_too(start: Start) -> None:
    """Of one that was never armed, since its emergency stop is pressed: the exciter may not run either."""
    run = start(excited=True)
    armed(run)
    for mode in (CeilingState.DISARMED, CeilingState.FAULT):
        run.supervisor._motor._state = CeilingState(mode=CeilingState.DISARMED)
        run.supervisor._on_state(CeilingState(mode=mode, fault="emergency stop"))
        assert run.supervisor._supervision.stopped == (
            "motor off: emergency stop" if mode == CeilingState.FAULT else ""
        )
    run.at_rest(1)


def test_a_stop_while_the_motor_is_being_armed_has_the_last_word(start: Start) -> None:
    run = start(excited=True)
    armed(run)
    assert run.call("stop").success
    client = run.peer.create_client(Trigger, "supervisor_node/rearm")
    run.until(client.service_is_ready)
    arming = client.call_async(Trigger.Request())
    run.until(lambda: not run.supervisor._supervision.stopped)  # it has begun to arm
    run.supervisor._stop("stopped by a test")
    run.until(arming.done)
    answer = arming.result()
    assert answer is not None
    assert (answer.success, answer.message) == (False, "not armed: stopped meanwhile: stopped by a test")
    run.at_rest(2)
    run.until(lambda: not run.motor._active)
