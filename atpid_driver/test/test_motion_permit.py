# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A supervised motor node moves only while a supervisor permits it: by its messages, and by none for too long."""

from collections.abc import Callable, Iterator

import pytest
from atpid_interfaces.msg import CeilingState, Event, SupervisorState
from lifecycle_msgs.msg import Transition
from motor_graph import Stand
from rclpy.node import Node
from std_srvs.srv import Trigger

from atpid_common.nodes.messages import STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_driver.nodes.authority import TOPIC, MotionPermit

#: Of the supervisor; longer than this process is suspended on a busy machine [s].
PATIENT = 5.0


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


class Supervisor:
    """A supervisor that states whatever a test needs, with every command."""

    def __init__(self, stand: Stand) -> None:
        self.stand = stand
        self.state = SupervisorState(state=SupervisorState.READY, permit=True)
        self._states = stand.peer.create_publisher(SupervisorState, TOPIC, STATES)

    def publish(self) -> None:
        self._states.publish(self.state)

    def command(self) -> None:
        """A height far away, with the statement beside it."""
        self.publish()
        self.stand.command(0.9, 1.0)

    def moving(self, timeout: float = PATIENT) -> None:
        """Wait until the ceiling moves with permission."""
        self.stand.motor(speed=0.01, supervised=True, supervision_timeout=timeout, command_timeout=PATIENT)
        self.stand.until(lambda: mode(self.stand) == CeilingState.MOVING, self.command)


def mode(stand: Stand) -> int:
    return int(stand.states[-1].mode) if stand.states else -1


def texts(stand: Stand, kind: str) -> list[str]:
    return [event.text for event in stand.events if event.kind == kind]


def held(stand: Stand, reason: str) -> Callable[[], bool]:
    """Whether it was held for this reason, and its heartbeats ended, which ends in the motor's own fault."""
    return lambda: f"the ceiling is held: {reason}" in texts(stand, Event.SUPERVISION) and mode(stand) == 5


def refused(stand: Stand, reason: str) -> None:
    """Neither a person nor a command moves it."""
    stand.until(lambda: f"ceiling height 0.9 m not taken up: {reason}" in texts(stand, Event.REFUSED))
    answer = stand.call(Trigger, "motor_node/rearm", Trigger.Request())
    assert (answer.success, answer.message) == (False, f"no motion is permitted: {reason}")


def test_without_a_supervisor_it_is_not_armed(stand: Stand) -> None:
    stand.motor(supervised=True)
    stand.until(lambda: mode(stand) == CeilingState.DISARMED)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    stand.until(lambda: len(stand.statuses) > 8)  # two seconds of its own diagnostics
    assert {state.mode for state in stand.states} <= {CeilingState.UNCONFIGURED, CeilingState.DISARMED}


def test_a_node_that_was_held_up_takes_the_newest_state_alone(stand: Stand) -> None:
    stops: list[str] = []
    node = Node("held_up", context=stand.context)
    permit = MotionPermit(node, stops.append, PATIENT, supervised=True)
    supervisor = Supervisor(stand)
    received: list[SupervisorState] = []
    stand.peer.create_subscription(SupervisorState, TOPIC, received.append, STATES)
    executor = TurnExecutor(context=stand.context)
    executor.add_node(node)
    while not permit.granted:  # the two have found one another
        supervisor.publish()
        executor.spin_once(timeout_sec=0.02)
    supervisor.publish()
    supervisor.state = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")
    supervisor.publish()
    stand.until(lambda: any(state.stop for state in received))
    executor.spin_once(timeout_sec=1.0)
    assert (permit.granted, stops) == (False, ["stopped by the operator"])
    node.destroy_node()


def test_one_that_is_not_supervised_needs_none(stand: Stand) -> None:
    stand.motor()
    stand.until(lambda: mode(stand) == CeilingState.HOLDING)


def test_a_permission_that_is_withdrawn_holds_it_without_heartbeats(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    supervisor.moving()
    supervisor.state = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="no answer of recorder_node")
    stand.states.clear()
    stand.until(held(stand, "no answer of recorder_node"), supervisor.command)
    assert CeilingState.HOLDING in {state.mode for state in stand.states}, "held at once, not by the missing heartbeat"
    height = stand.states[-1].height
    refused(stand, "no answer of recorder_node")
    supervisor.state = SupervisorState(state=SupervisorState.READY, permit=True)
    stand.states.clear()
    stand.until(lambda: len(stand.states) > 50, supervisor.command)
    assert {state.mode for state in stand.states} == {CeilingState.FAULT}, "a person arms it"
    assert stand.states[-1].height == height


def test_a_supervisor_that_falls_silent_withdraws_its_permission(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    supervisor.moving(timeout=0.5)
    stand.until(held(stand, "the supervisor is silent"), lambda: stand.command(0.9, 1.0))
    refused(stand, "the supervisor is silent")


def test_a_stop_switches_the_motor_off_until_it_is_activated_again(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    supervisor.moving()
    supervisor.state = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")
    stand.until(lambda: mode(stand) == CeilingState.DISARMED, supervisor.publish)
    stand.until(lambda: texts(stand, Event.STOPPED))
    assert [text.endswith(": stopped by the operator") for text in texts(stand, Event.STOPPED)] == [True]
    supervisor.state = SupervisorState(state=SupervisorState.READY, permit=True)
    stand.states.clear()
    stand.until(lambda: len(stand.states) > 50, supervisor.command)
    assert {state.mode for state in stand.states} == {CeilingState.DISARMED}


def test_homing_ends_where_the_permission_is_withdrawn(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    stand.motor(initial_height=float("nan"), supervised=True, supervision_timeout=PATIENT)
    stand.until(lambda: mode(stand) == CeilingState.HOMING, supervisor.publish)
    supervisor.state = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="no answer of recorder_node")
    stand.until(lambda: mode(stand) == CeilingState.DISARMED, supervisor.publish)
    stand.until(lambda: texts(stand, Event.STOPPED))
    assert texts(stand, Event.STOPPED) == ["motor switched off: no answer of recorder_node"]
