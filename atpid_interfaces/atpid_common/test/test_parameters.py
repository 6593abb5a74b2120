# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters from a table: defaults, ranges, and changes while the node runs."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import Event
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.errors import InputError
from atpid_common.nodes.parameters import Entry, LiveParameters, ParameterError, refuse_undeclared

TABLE = (
    Entry("scene", "", "scene file"),
    Entry("method", "lookup", "method", choices=("lookup", "direct")),
    Entry("onset", 0.06, "from here it is irregular", "-", 0.0, 1.0, live=True),
    Entry("calm", 0.03, "below it is calm again", "-", 0.0, 1.0, live=True),
    Entry("count", 4, "how many", "", 1, 10, live=True),
)


class Applied:
    """What a node made of its parameters."""

    def __init__(self, context: Context, **given: Any) -> None:
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        self.node = Node("tested", context=context, parameter_overrides=overrides)
        self.parameters = LiveParameters(self.node, TABLE)
        self.applied: list[tuple[float, float, int]] = []
        self.events: list[tuple[int, str, str, float]] = []
        self.parameters.follow(self.build, self.applied.append, lambda *event: self.events.append(event))

    @staticmethod
    def build(value: Any) -> tuple[float, float, int]:
        if value("calm") > value("onset"):
            raise InputError(f"calm: given {value('calm'):g}; allowed: at most onset")
        return value("onset"), value("calm"), value("count")

    def set(self, **values: Any) -> Any:
        return self.node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])


@pytest.fixture
def context() -> Iterator[Context]:
    made = Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


@pytest.fixture
def tested(context: Context) -> Iterator[Applied]:
    made = Applied(context)
    yield made
    made.node.destroy_node()


def test_a_node_starts_with_the_defaults(tested: Applied) -> None:
    assert [tested.parameters[row.name] for row in TABLE] == [row.default for row in TABLE]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"onset": 2.0}, "parameter onset of tested: given 2; allowed: 0 to 1"),
        ({"onset": math.nan}, "parameter onset of tested: given nan; allowed: 0 to 1"),
        ({"method": "guess"}, "parameter method of tested: given 'guess'; allowed: 'lookup', 'direct'"),
        ({"count": 0}, "parameter count of tested: given 0; allowed: 1 to 10"),
        ({"count": 1.5}, "count"),
    ],
)
def test_an_impossible_value_is_refused_at_the_start(context: Context, given: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError) as refused:
        Applied(context, **given)
    assert text in str(refused.value)


def test_a_live_parameter_is_applied_and_recorded_with_old_and_new_value(tested: Applied) -> None:
    assert tested.set(onset=0.1).successful
    assert tested.applied == [(0.1, 0.03, 4)]
    assert tested.parameters["onset"] == 0.1
    assert tested.events == [(Event.INFO, Event.PARAMETER, "parameter onset: 0.06 -> 0.1", 0.1)]


def test_setting_the_value_it_has_is_no_event(tested: Applied) -> None:
    assert tested.set(count=4).successful
    assert tested.events == []


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"onset": 2.0}, "onset"),
        ({"onset": math.nan}, "onset"),
        ({"calm": 0.5}, "calm: given 0.5; allowed: at most onset"),
        ({"count": 11}, "count"),
        ({"scene": "other.yaml"}, "read-only"),
    ],
)
def test_a_bad_value_is_refused_with_a_sentence_and_changes_nothing(
    tested: Applied, values: dict[str, Any], reason: str
) -> None:
    result = tested.set(**values)
    assert not result.successful
    assert reason in result.reason
    assert tested.applied == []
    assert tested.events == []
    assert tested.parameters["onset"] == 0.06


def test_values_that_fit_together_may_change_together(tested: Applied) -> None:
    assert tested.set(onset=0.6, calm=0.5).successful
    assert tested.applied == [(0.6, 0.5, 4)]
    assert len(tested.events) == 2


def test_description_and_range_can_be_asked_for(tested: Applied) -> None:
    described = tested.node.describe_parameter("onset")
    assert described.description == "from here it is irregular [-]"
    assert (described.floating_point_range[0].from_value, described.floating_point_range[0].to_value) == (0.0, 1.0)
    assert not described.read_only
    assert tested.node.describe_parameter("method").additional_constraints == "one of: lookup, direct"
    assert tested.node.describe_parameter("scene").read_only


def test_a_value_for_a_parameter_that_the_node_does_not_have_is_refused(context: Context) -> None:
    applied = Applied(context, onset=0.07, cuont=5)
    try:
        with pytest.raises(
            ParameterError, match=r"parameter cuont of tested: the node has none .*did you mean count\?"
        ):
            refuse_undeclared(applied.node)
        refuse_undeclared(applied.node, ["cuont"])
    finally:
        applied.node.destroy_node()
