# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Declares a node's parameters from a table.

An invalid value is refused in one line, at the start and while the node runs.
"""

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeVar

from atpid_interfaces.msg import Event
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.errors import InputError, did_you_mean
from atpid_common.parameters import Entry, Value, Values

T = TypeVar("T")
Publish = Callable[[int, str, str, float], None]  # publishes an event: its severity, kind, text and value


class ParameterError(InputError):
    """A parameter that is missing or impossible."""


#: Parameters that have to be given, by the type of their values.
_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    list: Parameter.Type.STRING_ARRAY,
}


def _descriptor(row: Entry) -> ParameterDescriptor:
    """Return the row as `ros2 param describe` shows it."""
    made = ParameterDescriptor(name=row.name, description=row.meaning, read_only=not row.live)
    if row.choices:
        made.additional_constraints = f"one of: {', '.join(row.choices)}"
    if row.low is not None and row.high is not None:
        if row.kind is int:
            made.integer_range = [IntegerRange(from_value=int(row.low), to_value=int(row.high), step=0)]
        else:
            made.floating_point_range = [FloatingPointRange(from_value=row.low, to_value=row.high, step=0.0)]
    return made


def declare(node: Node, table: Sequence[Entry]) -> Values:
    """Declare the table's parameters; return their values by name. Raises ParameterError."""
    return {row.name: _declare(node, row) for row in table}


def _declare(node: Node, row: Entry) -> Any:
    where = f"parameter {row.name} of {node.get_name()}"
    try:
        default = _TYPES[row.default] if isinstance(row.default, type) else row.default
        value = node.declare_parameter(row.name, default, _descriptor(row)).value
    except (ParameterException, ValueError, TypeError) as error:
        given = node._parameter_overrides.get(row.name)
        problem = row.problem(given.value) if given is not None and given.value is not None else ""
        raise ParameterError(f"{where}: {problem or error}") from error
    if value is None:
        raise ParameterError(f"{where} is not given: {row.description}; set it in the parameter file")
    if problem := row.problem(value):
        raise ParameterError(f"{where}: {problem}")
    return value


#: What rclpy declares when it is needed.
_OF_RCLPY = "qos_overrides."


def refuse_undeclared(node: Node, also: Collection[str] = ()) -> None:
    """Raise ParameterError for a value given to a parameter that the node does not have: rclpy would ignore it.

    also: names that are none of the node's and may be given.
    """
    for name in node._parameter_overrides:
        if not (node.has_parameter(name) or name in also or name.startswith(_OF_RCLPY)):
            declared = [parameter.name for parameter in node.get_parameters_by_prefix("").values()]
            hint = did_you_mean(name, declared)
            where = f"parameter {name} of {node.get_name()}: the node has none of this name{hint}"
            raise ParameterError(f"{where}; all of them are in docs/parameters.md")


class LiveParameters:
    """The parameters of a node, current while it runs: `parameters["margin"]` is the value in force."""

    def __init__(self, node: Node, table: Sequence[Entry]) -> None:
        """Declare the table. Raises ParameterError."""
        self._node, self._rows = node, {row.name: row for row in table if row.live}
        self._values = declare(node, table)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def follow(self, build: Callable[[Value], T], apply: Callable[[T], None], events: Publish) -> None:
        """Validate changes of live parameters, apply accepted ones, and record each as an event.

        build: returns what the node works with from a function that returns a parameter's value by name; an InputError
        it raises refuses the change with its text. apply: takes that into use after the values are set; what it raises
        refuses nothing any more and is a defect. events: `EventPublisher.publish`.
        """

        def validate(parameters: list[Parameter]) -> SetParametersResult:
            values = self._live(parameters)
            for name, value in values.items():
                unset = "given nothing; a parameter cannot be unset" if value is None else ""
                if problem := unset or self._rows[name].problem(value):
                    return SetParametersResult(successful=False, reason=f"parameter {name}: {problem}")
            try:
                build((self._values | values).__getitem__)
            except InputError as error:
                return SetParametersResult(successful=False, reason=str(error))
            return SetParametersResult(successful=True)

        def accept(parameters: list[Parameter]) -> None:
            values = self._live(parameters)
            if not values:
                return
            before, self._values = self._values, self._values | values
            apply(build(self._values.__getitem__))
            for name, value in values.items():
                if value != before[name]:
                    quantity = float(value) if isinstance(value, int | float) else math.nan
                    events(Event.INFO, Event.PARAMETER, f"parameter {name}: {before[name]} -> {value}", quantity)

        self._node.add_on_set_parameters_callback(validate)
        self._node.add_post_set_parameters_callback(accept)

    def _live(self, parameters: list[Parameter]) -> Values:
        return {parameter.name: parameter.value for parameter in parameters if parameter.name in self._rows}
