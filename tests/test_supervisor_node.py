# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The supervisor node over real DDS, beside a motor node and one that answers because it spins."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import CeilingCommand, Event, SampleBlock, SupervisorState
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from atpid_common.nodes.messages import BLOCKS, STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.supervisor_node import SupervisorNode
from atpid_driver.nodes.motor_node import MotorNode

#: Longer than this process is suspended on a busy machine [s].
PATIENT = 5.0
#: Of what is waited for [s].
LIMIT = 40.0
MOTOR = {
    "backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.01, "initial_height": 0.017,
    "supervised": True, "supervision_timeout": PATIENT, "command_timeout": PATIENT,
}  # fmt: skip


class Run:
    """A supervisor, the node that it needs, and what a run publishes."""

    def __init__(self, **parameters: Any) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.selector, self.peer = (Node(name, context=self.context) for name in ("selector_node", "peer"))
        given = {"nodes": ["selector_node"], "needed": ["selector_node"], "answer_time": PATIENT, "check_time": 0.0}
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
        for node in (self.selector, self.peer, self.supervisor, self.motor):
            self.executor.add_node(node)

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

    def call(self, name: str) -> Any:
        client = self.peer.create_client(Trigger, f"supervisor_node/{name}")
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
        for node in (self.selector, self.peer, self.supervisor, self.motor):
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
