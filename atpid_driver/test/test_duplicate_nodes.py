# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A second motor node of one name: one that was there before keeps this one off for as long as it is there."""

from collections.abc import Iterator

import pytest
from atpid_interfaces.msg import CeilingState, Event
from lifecycle_msgs.msg import Transition
from motor_graph import Stand
from rclpy.node import Node

from atpid_driver.nodes.authority import DISCOVERY_TIME

pytestmark = pytest.mark.slow
#: Reports of its diagnostics, one a second: longer than the node waits before it tries again.
REPORTS = 3


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def reported(stand: Stand) -> int:
    return sum(status.name == "motor_node: ceiling motor" for status in stand.statuses)


def test_while_another_is_there_that_was_there_before_nothing_arms_it(stand: Stand) -> None:
    """Neither its own start, which is tried again and again, nor a person; and however long the other stays."""
    node = stand.motor()
    other = Node("motor_node", context=stand.context)
    stand.until(lambda: any(event.kind == Event.DUPLICATE for event in stand.events))
    stand.until(lambda: stand.states[-1].mode == CeilingState.DISARMED)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    node._duplicates.started -= DISCOVERY_TIME
    stand.states.clear()
    before = reported(stand)
    stand.until(lambda: reported(stand) >= before + REPORTS)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    assert {state.mode for state in stand.states} == {CeilingState.DISARMED}
    other.destroy_node()
    stand.until(lambda: stand.states[-1].mode == CeilingState.HOLDING)
