# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whose commands the motor follows: a second publisher of ceiling/command moves nothing, and is named."""

from collections.abc import Iterator
from itertools import count

import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event
from builtin_interfaces.msg import Time as TimeMsg
from motor_graph import Stand
from rclpy.node import Node
from std_msgs.msg import Header

from atpid_driver.nodes.authority import Commander

FIRST, FOREIGN = 0.3, 0.9  # heights [m]


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def refusals(stand: Stand) -> list[str]:
    return [event.text for event in stand.events if event.kind == Event.REFUSED and event.severity == Event.ALARM]


def at_rest(stand: Stand, height: float) -> bool:
    state = stand.states[-1]
    return bool(state.mode == CeilingState.HOLDING and state.height == height)


def test_beside_an_unauthorised_publisher_nothing_moves_until_it_is_gone(stand: Stand) -> None:
    stand.motor(speed=5.0)
    stand.handshake()
    stand.until(lambda: at_rest(stand, FIRST), lambda: stand.command(FIRST, 1.0))
    intruder = Node("intruder", context=stand.context)
    foreign = intruder.create_publisher(CeilingCommand, "ceiling/command", 1)
    stand.states.clear()

    def both() -> None:
        far = Header(stamp=TimeMsg(sec=2**31 - 1))
        foreign.publish(CeilingCommand(header=far, height=FOREIGN, sequence=9))
        stand.command(0.5, 2.0)

    stand.until(lambda: refusals(stand) and len(stand.states) > 50, both)
    assert {state.target for state in stand.states} == {FIRST}
    assert len(refusals(stand)) == 1  # not with every command
    assert refusals(stand)[0].endswith(
        "ceiling/command is published by /intruder and /peer; none is followed until there is one"
    )
    stand.until(lambda: any(s.level == s.ERROR and "/intruder" in s.message for s in stand.statuses), both)
    intruder.destroy_node()
    stand.until(lambda: at_rest(stand, 0.5), lambda: stand.command(0.5, 3.0))


def test_it_stops_a_ceiling_on_its_way(stand: Stand) -> None:
    stand.motor(speed=0.05)
    stand.handshake()
    stand.until(lambda: stand.states[-1].mode == CeilingState.MOVING, lambda: stand.command(FIRST, 1.0))
    intruder = Node("intruder", context=stand.context)
    intruder.create_publisher(CeilingCommand, "ceiling/command", 1)
    stand.until(lambda: stand.states[-1].mode == CeilingState.HOLDING, lambda: stand.command(FIRST, 2.0))
    assert stand.states[-1].height < FIRST


def test_of_two_of_one_name_that_both_send_the_first_is_followed(stand: Stand) -> None:
    """As a node on another machine that was given the controller's name; each counts its own messages."""
    stand.motor(speed=5.0)
    stand.handshake()
    stand.until(lambda: at_rest(stand, FIRST), lambda: stand.command(FIRST, 1.0))
    foreign = stand.peer.create_publisher(CeilingCommand, "ceiling/command", 10)
    stand.states.clear()

    def alternately() -> None:  # the motor keeps one command, the newest
        if turn := next(turns) % 2:
            stand.command(FIRST, float(turn))
        else:
            foreign.publish(CeilingCommand(height=FOREIGN, sequence=9))

    turns = count()
    stand.until(lambda: refusals(stand) and len(stand.states) > 50, alternately)
    assert {state.target for state in stand.states} == {FIRST}
    assert "two nodes of one name" in refusals(stand)[0]


def test_one_that_was_started_again_is_followed(stand: Stand) -> None:
    stand.motor(speed=5.0)
    stand.handshake()
    stand.until(lambda: at_rest(stand, FIRST), lambda: stand.command(FIRST, 1.0))
    stand.commands = stand.peer.create_publisher(CeilingCommand, "ceiling/command", 10)  # its former self stays
    stand.until(lambda: at_rest(stand, 0.4), lambda: stand.command(0.4, 2.0))


def test_the_stands_motor_follows_the_node_named_only(stand: Stand) -> None:
    stand.motor(speed=5.0, commander="selector_node")
    stand.handshake()
    stand.until(lambda: at_rest(stand, 0.017))
    stand.until(lambda: refusals(stand), lambda: stand.command(FOREIGN, 1.0))
    assert refusals(stand)[0].endswith("published by /peer; allowed: /selector_node (parameter commander)")
    assert stand.states[-1].target == 0.017
    stand.peer.destroy_publisher(stand.commands)
    selector = Node("selector_node", context=stand.context)
    stand.commands = selector.create_publisher(CeilingCommand, "ceiling/command", 10)
    stand.until(lambda: at_rest(stand, FIRST), lambda: stand.command(FIRST, 2.0))
    selector.destroy_node()


@pytest.mark.parametrize("numbers", [[1, 2, 3, 500], [0, 0, 0]])
def test_lost_messages_and_a_middleware_without_a_count_are_no_second_publisher(
    stand: Stand, numbers: list[int]
) -> None:
    judge = Commander(stand.peer, "ceiling/command", "", 60.0)
    assert [judge.judge(number) for number in numbers] == [""] * len(numbers)


def test_a_count_that_goes_back_or_leaps_is_another_publishers_until_the_first_has_left(stand: Stand) -> None:
    judge = Commander(stand.peer, "ceiling/command", "", 60.0)
    assert judge.judge(500) == ""
    assert all("two nodes of one name" in judge.judge(number) for number in (3, 500, 500 + 1001))
    assert judge.judge(501) == ""
    left = Commander(stand.peer, "ceiling/command", "", -1.0)
    assert [left.judge(number) for number in (500, 3)] == ["", ""]
