# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who may move the ceiling: one publisher of commands, and only while a supervisor permits it, by its messages."""

from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import count
from math import nan

import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, SupervisorState
from builtin_interfaces.msg import Time as TimeMsg
from lifecycle_msgs.msg import Transition
from motor_graph import Stand
from motor_rigs import words
from rclpy.node import Node
from std_msgs.msg import Header

from atpid_common.nodes.messages import STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import repeated_after_a_halt
from atpid_driver.nodes.authority import TOPIC, Commander, MotionPermit

pytestmark = repeated_after_a_halt

#: Of the supervisor; longer than this process is suspended on a busy machine [s].
PATIENT = 10.0
FIRST, FOREIGN = 0.3, 0.9  # heights [m]
STOPPED = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")
WITHDRAWN = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="no answer of recorder_node")


@pytest.fixture
def stand() -> Iterator[Stand]:
    with closing(Stand()) as made:
        yield made


class Supervisor:
    """A supervisor that states whatever a test needs, with every command."""

    def __init__(self, stand: Stand) -> None:
        self.stand = stand
        self.permit()
        self._states = stand.peer.create_publisher(SupervisorState, TOPIC, STATES)

    def permit(self) -> None:
        self.state = SupervisorState(state=SupervisorState.READY, permit=True)

    def publish(self) -> None:
        self._states.publish(self.state)

    def command(self) -> None:
        """A height far away, with the statement beside it."""
        self.publish()
        self.stand.command(0.9, 1.0)

    def moving(self, timeout: float = PATIENT) -> None:
        """Wait until the ceiling moves with permission."""
        self.stand.motor(speed=0.01, supervised=True, supervision_timeout=timeout, command_timeout=PATIENT)
        self.stand.until_mode(CeilingState.MOVING, self.command)


def until_held(stand: Stand, reason: str, act: Callable[[], None]) -> None:
    """Wait until it is held for this reason, and its heartbeats have ended, which ends in the motor's own fault.

    Neither a person nor a command moves it then.
    """
    stand.until(
        lambda: (
            any(text.endswith(reason) for text in stand.texts(Event.SUPERVISION))
            and stand.state.mode == CeilingState.FAULT
        ),
        act,
    )
    stand.until(lambda: any("0.9" in text and text.endswith(reason) for text in stand.texts(Event.REFUSED)))
    answer = stand.trigger("rearm")
    assert not answer.success
    assert answer.message.endswith(reason)


def test_without_a_supervisor_it_is_not_armed(stand: Stand) -> None:
    stand.motor(supervised=True)
    stand.until_mode(CeilingState.DISARMED)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    stand.until(lambda: len(stand.statuses) > 4)  # a second of its own diagnostics
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
    supervisor.state = STOPPED
    supervisor.publish()
    stand.until(lambda: any(state.stop for state in received))
    executor.spin_once(timeout_sec=1.0)
    assert (permit.granted, stops) == (False, [STOPPED.reason])
    node.destroy_node()


def test_a_permission_that_is_withdrawn_holds_it_without_heartbeats(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    supervisor.moving()
    supervisor.state = WITHDRAWN
    stand.states.clear()
    until_held(stand, WITHDRAWN.reason, supervisor.command)
    assert CeilingState.HOLDING in {state.mode for state in stand.states}, "held at once, not by the missing heartbeat"
    height = stand.state.height
    supervisor.permit()
    assert stand.more_states(50, supervisor.command) == {CeilingState.FAULT}, "a person arms it"
    assert stand.state.height == height


def test_a_supervisor_that_falls_silent_withdraws_its_permission(stand: Stand) -> None:
    Supervisor(stand).moving(timeout=1.0)
    until_held(stand, "silent", lambda: stand.command(0.9, 1.0))


def test_a_stop_switches_the_motor_off_until_it_is_activated_again(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    supervisor.moving()
    supervisor.state = STOPPED
    stand.until_mode(CeilingState.DISARMED, supervisor.publish)
    stand.until(lambda: stand.texts(Event.STOPPED))
    assert [text.endswith(f": {STOPPED.reason}") for text in stand.texts(Event.STOPPED)] == [True]
    supervisor.permit()
    assert stand.more_states(50, supervisor.command) == {CeilingState.DISARMED}


def test_homing_ends_where_the_permission_is_withdrawn(stand: Stand) -> None:
    supervisor = Supervisor(stand)
    stand.motor(initial_height=nan, supervised=True, supervision_timeout=PATIENT)
    stand.until_mode(CeilingState.HOMING, supervisor.publish)
    supervisor.state = WITHDRAWN
    stand.until_mode(CeilingState.DISARMED, supervisor.publish)
    stand.until(lambda: stand.texts(Event.STOPPED))
    (text,) = stand.texts(Event.STOPPED)
    assert text.endswith(f": {WITHDRAWN.reason}")


# whose commands are followed


def alarms(stand: Stand) -> list[str]:
    return [event.text for event in stand.events if event.kind == Event.REFUSED and event.severity == Event.ALARM]


def at_rest(stand: Stand, height: float, stamp: float = 1.0) -> None:
    """Command `height` until the ceiling rests there."""
    stand.until(
        lambda: stand.state.mode == CeilingState.HOLDING and stand.state.height == height,
        lambda: stand.command(height, stamp),
    )


@pytest.fixture
def first(stand: Stand) -> Stand:
    """A motor that has followed its first publisher."""
    stand.motor(speed=5.0)
    stand.handshake()
    at_rest(stand, FIRST)
    return stand


def test_beside_an_unauthorised_publisher_nothing_moves_until_it_is_gone(first: Stand) -> None:
    intruder = Node("intruder", context=first.context)
    foreign = intruder.create_publisher(CeilingCommand, "ceiling/command", 1)
    first.states.clear()

    def both() -> None:
        far = Header(stamp=TimeMsg(sec=2**31 - 1))
        foreign.publish(CeilingCommand(header=far, height=FOREIGN, sequence=9))
        first.command(0.5, 2.0)

    first.until(lambda: alarms(first) and len(first.states) > 50, both)
    assert {state.target for state in first.states} == {FIRST}
    (alarm,) = alarms(first)  # not with every command
    assert {"ceiling/command", "/intruder", "/peer"} <= words(alarm)
    first.until(lambda: any(s.level == s.ERROR and "/intruder" in s.message for s in first.statuses), both)
    intruder.destroy_node()
    at_rest(first, 0.5, 3.0)


def test_it_stops_a_ceiling_on_its_way(stand: Stand) -> None:
    stand.motor(speed=0.05)
    stand.handshake()
    stand.until_mode(CeilingState.MOVING, lambda: stand.command(FIRST, 1.0))
    intruder = Node("intruder", context=stand.context)
    intruder.create_publisher(CeilingCommand, "ceiling/command", 1)
    stand.until_mode(CeilingState.HOLDING, lambda: stand.command(FIRST, 2.0))
    assert stand.state.height < FIRST
    intruder.destroy_node()


def test_of_two_of_one_name_that_both_send_the_first_is_followed(first: Stand) -> None:
    """As a node on another machine that was given the controller's name; each counts its own messages."""
    foreign = first.peer.create_publisher(CeilingCommand, "ceiling/command", 10)
    first.states.clear()
    turns = count()

    def alternately() -> None:  # the motor keeps one command, the newest
        if turn := next(turns) % 2:
            first.command(FIRST, float(turn))
        else:
            foreign.publish(CeilingCommand(height=FOREIGN, sequence=9))

    first.until(lambda: alarms(first) and len(first.states) > 50, alternately)
    assert {state.target for state in first.states} == {FIRST}
    assert {"ceiling/command", "two", "name"} <= words(alarms(first)[0])


def test_one_that_was_started_again_is_followed(first: Stand) -> None:
    first.commands = first.peer.create_publisher(CeilingCommand, "ceiling/command", 10)  # its former self stays
    at_rest(first, 0.4, 2.0)


def test_the_stands_motor_follows_the_node_named_only(stand: Stand) -> None:
    stand.motor(speed=5.0, commander="selector_node")
    stand.handshake()
    stand.until_mode(CeilingState.HOLDING)
    stand.until(lambda: alarms(stand), lambda: stand.command(FOREIGN, 1.0))
    assert {"/peer", "/selector_node", "commander"} <= words(alarms(stand)[0])
    assert stand.state.target == 0.017
    stand.peer.destroy_publisher(stand.commands)
    selector = Node("selector_node", context=stand.context)
    stand.commands = selector.create_publisher(CeilingCommand, "ceiling/command", 10)
    at_rest(stand, FIRST, 2.0)
    selector.destroy_node()


def test_a_count_that_goes_back_or_leaps_is_another_publishers_until_the_first_has_left(stand: Stand) -> None:
    """Lost messages, and a middleware without a count, are no second publisher."""

    def judged(numbers: list[int], silence: float = 60.0) -> list[bool]:
        judge = Commander(stand.peer, "ceiling/command", "", silence)
        return [judge.judge(number) == "" for number in numbers]

    assert judged([1, 2, 3, 500]) == [True] * 4
    assert judged([0, 0, 0]) == [True] * 3
    assert judged([500, 3, 500, 500 + 1001, 501]) == [True, False, False, False, True]
    assert judged([500, 3], silence=-1.0) == [True, True]
