# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The declaration of a parameter: a row of a node's table, or a field of a dataclass from which such rows are made."""

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import partial
from typing import Any

Values = dict[str, Any]  # of parameters by name
Value = Callable[[str], Any]  # the value of a parameter by its name; raises an InputError where there is none
#: What a value may be, in words, by its type; a list is checked by the node that has it.
_ALLOWED = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


@dataclass(frozen=True)
class Entry:
    """One parameter. `default` is a value, or its type where it must be given."""

    name: str
    default: Any
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def kind(self) -> type:
        """Type of its values."""
        return self.default if isinstance(self.default, type) else type(self.default)

    @property
    def meaning(self) -> str:
        """Description and unit."""
        return self.description + (f" [{self.unit}]" if self.unit else "")

    def problem(self, value: object) -> str:
        """Return what is wrong with `value`, in words; empty: nothing."""
        if self.choices and value not in self.choices:
            return f"given {value!r}; allowed: {', '.join(map(repr, self.choices))}"
        if self.kind in _ALLOWED and not isinstance(value, (float, int) if self.kind is float else self.kind):
            return f"given {value!r}; allowed: {_ALLOWED[self.kind]}"
        if self.low is None or self.high is None or not isinstance(value, int | float):
            return ""
        if math.isnan(value) or not self.low <= value <= self.high:
            unit = f" {self.unit}" if self.unit not in ("", "-") else ""
            return f"given {value:g}{unit}; allowed: {self.low:g} to {self.high:g}{unit}"
        return ""


def setting(
    default: Any, description: str, unit: str = "", *span: float, choices: tuple[str, ...] = (), live: bool = False
) -> Any:
    """Return the field of a dataclass that is a parameter: arguments as of `Entry`, its name is the field's.

    span: lowest and highest value, where it has a range.
    """
    value = list(default) if isinstance(default, tuple) else default
    low, high = span or (None, None)
    row = Entry("", value, description, unit, low, high, choices, live)
    return field(default=MISSING if isinstance(default, type) else default, metadata={"row": row})


#: The same of one that may change while the node runs.
live = partial(setting, live=True)


def rows_of(model: type, prefix: str = "") -> tuple[Entry, ...]:
    """Return the parameters that a dataclass declares by `setting`; prefix: of their names."""
    return tuple(replace(one.metadata["row"], name=prefix + one.name) for one in fields(model) if one.metadata)


def problem_of(settings: object) -> str:
    """Return which parameter of such a dataclass is wrong, and why, in one line; empty: none is."""
    found = ((row.name, row.problem(getattr(settings, row.name))) for row in rows_of(type(settings)))
    return next((f"{name}: {problem}" for name, problem in found if problem), "")
