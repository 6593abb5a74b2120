# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters from a table: defaults, ranges, and changes while the node runs."""

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import Event
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.errors import InputError
from atpid_common.nodes.parameters import LiveParameters, ParameterError, refuse_undeclared
from atpid_common.parameters import Entry

TABLE = (
    Entry("scene", "", "scene file"),
    Entry("method", "lookup", "method", choices=("lookup", "direct")),
    Entry("onset", 0.06, "irregular from here", "-", 0.0, 1.0, live=True),
    Entry("calm", 0.03, "below it is calm again", "-", 0.0, 1.0, live=True),
    Entry("count", 4, "how many", "", 1, 10, live=True),
)


class Applied:
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
            raise InputError(f"onset: {value('onset')}")
        return value("onset"), value("calm"), value("count")

    def set(self, **values: Any) -> Any:
        return self.node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])


@pytest.fixture(scope="module")
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


def test_a_node_starts_with_the_defaults_and_describes_them(tested: Applied) -> None:
    assert [tested.parameters[row.name] for row in TABLE] == [row.default for row in TABLE]
    onset, method, scene = (tested.node.describe_parameter(name) for name in ("onset", "method", "scene"))
    assert onset.description == f"{TABLE[2].description} [-]"
    assert (onset.floating_point_range[0].from_value, onset.floating_point_range[0].to_value) == (0.0, 1.0)
    assert (onset.read_only, scene.read_only) == (False, True)
    assert all(choice in method.additional_constraints for choice in TABLE[1].choices)


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        ({"onset": 2.0}, "onset.* 2;.* 0 .* 1$"),
        ({"onset": math.nan}, "onset.* nan;.* 0 .* 1$"),
        ({"method": "guess"}, "method.* 'guess';.* 'lookup', 'direct'"),
        ({"count": 0}, "count.* 0;.* 1 .* 10"),
        ({"count": 1.5}, "count"),
    ],
)
def test_an_impossible_value_is_refused_at_the_start(context: Context, given: dict[str, Any], parts: str) -> None:
    with pytest.raises(ParameterError, match=parts):
        Applied(context, **given)


def test_a_live_parameter_is_applied_and_recorded_with_old_and_new_value(tested: Applied) -> None:
    assert tested.set(onset=0.1).successful
    assert tested.applied == [(0.1, 0.03, 4)]
    assert tested.parameters["onset"] == 0.1
    ((severity, kind, text, value),) = tested.events
    assert (severity, kind, value) == (Event.INFO, Event.PARAMETER, 0.1)
    assert re.search(r"onset\b.*0\.06.*0\.1", text)
    assert tested.set(count=4).successful  # the value it has is no event
    assert len(tested.events) == 1


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"onset": 2.0}, "onset"),
        ({"onset": math.nan}, "onset"),
        ({"calm": 0.5}, "onset: 0.06"),
        ({"count": 11}, "count"),
        ({"scene": "other.yaml"}, "read-only"),
    ],
)
def test_a_bad_value_is_refused_and_changes_nothing(tested: Applied, values: dict[str, Any], reason: str) -> None:
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


def test_a_value_for_a_parameter_that_the_node_does_not_have_is_refused(context: Context) -> None:
    applied = Applied(context, onset=0.07, cuont=5)
    try:
        with pytest.raises(ParameterError, match=r"cuont.*tested.*\bcount\?"):
            refuse_undeclared(applied.node)
        refuse_undeclared(applied.node, ["cuont"])
    finally:
        applied.node.destroy_node()
