# SPDX-License-Identifier: Apache-2.0
"""Declares a node's parameters from a table: name, default, description, unit, range, and whether it may change live.

A value that cannot be is refused in one line, at the start and while the node runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.errors import InputError


class ParameterError(InputError):
    """A parameter that is missing or impossible."""


@dataclass(frozen=True)
class Row:
    """One parameter. `default` is a value, or a Parameter.Type where it must be given."""

    name: str
    default: Any
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the row as `ros2 param describe` shows it."""
        unit = f" [{self.unit}]" if self.unit else ""
        made = ParameterDescriptor(name=self.name, description=self.description + unit, read_only=not self.live)
        if self.choices:
            made.additional_constraints = f"one of: {', '.join(self.choices)}"
        if self.low is not None and self.high is not None:
            integer = isinstance(self.default, int) or self.default == Parameter.Type.INTEGER
            if integer:
                made.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high), step=0)]
            else:
                made.floating_point_range = [FloatingPointRange(from_value=self.low, to_value=self.high, step=0.0)]
        return made

    def problem(self, value: Any) -> str:
        """Return what is wrong with `value`, in words; empty: nothing."""
        if self.choices and value not in self.choices:
            return f"given {value!r}; allowed: {', '.join(map(repr, self.choices))}"
        if self.low is None or self.high is None or isinstance(value, str):
            return ""
        if math.isnan(value) or not self.low <= value <= self.high:
            unit = f" {self.unit}" if self.unit else ""
            return f"given {value:g}{unit}; allowed: {self.low:g} to {self.high:g}{unit}"
        return ""


def declare(node: Node, table: Sequence[Row]) -> dict[str, Any]:
    """Declare the table's parameters; return their values by name. Raises ParameterError."""
    return {row.name: _declare(node, row) for row in table}


def _declare(node: Node, row: Row) -> Any:
    where = f"parameter {row.name} of {node.get_name()}"
    try:
        value = node.declare_parameter(row.name, row.default, row.descriptor()).value
    except (ParameterException, ValueError, TypeError) as error:
        given = node._parameter_overrides.get(row.name)
        problem = row.problem(given.value) if given is not None and given.value is not None else ""
        raise ParameterError(f"{where}: {problem or error}") from error
    if value is None:
        raise ParameterError(f"{where} is not given: {row.description}; set it in the parameter file")
    if problem := row.problem(value):
        raise ParameterError(f"{where}: {problem}")
    return value


def follow(node: Node, table: Sequence[Row], changed: Callable[[dict[str, Any]], None]) -> None:
    """Validate changes of the live parameters and pass accepted ones to `changed` (name: value).

    `changed` is called after the values are set; what it raises as InputError refuses nothing any more and is a defect.
    """
    rows = {row.name: row for row in table if row.live}

    def validate(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            row = rows.get(parameter.name)
            problem = row.problem(parameter.value) if row is not None and parameter.value is not None else ""
            if problem:
                return SetParametersResult(successful=False, reason=f"parameter {parameter.name}: {problem}")
        return SetParametersResult(successful=True)

    def accept(parameters: list[Parameter]) -> None:
        values = {parameter.name: parameter.value for parameter in parameters if parameter.name in rows}
        if values:
            changed(values)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(accept)
