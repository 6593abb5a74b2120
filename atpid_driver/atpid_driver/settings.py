# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes that move something: each is declared once, with its meaning, unit and range."""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

from atpid_driver import SettingsError


def described(
    description: str, unit: str = "", low: float | None = None, high: float | None = None, *,
    default: Any = MISSING, choices: Sequence[str] = (), live: bool = False,
) -> Any:  # fmt: skip
    """Return a field that is a parameter of the node: meaning, unit, range; without a default it must be set.

    live: it may change while the node runs. The node's table and docs/parameters.md follow from it.
    """
    metadata = {"description": description, "unit": unit, "low": low, "high": high, "choices": choices, "live": live}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class SupervisedSettings:
    """What the nodes of motor and exciter have in common, SI units."""

    rate: float
    stale_timeout: float
    lockstep: bool = described(
        "answer each message with one state at its stamp instead of publishing on an own period", default=False
    )
    autostart: bool = described("configure and activate without a lifecycle manager", default=True)
    command_timeout: float = described(
        "a command that waited longer is ignored; not used in lockstep", "s", 0.01, 10.0, default=0.5
    )
    commander: str = described(
        "name of the only node whose commands are followed; empty: of any, one at a time", default=""
    )
    supervised: bool = described("move only while the supervisor permits it; not used in lockstep", default=False)
    supervision_timeout: float = described(
        "silence of the supervisor that withdraws its permission", "s", 0.1, 10.0, default=0.3
    )

    def __post_init__(self) -> None:
        """Raise `SettingsError` for a value outside its range or choices."""
        for one in fields(self):
            described, value = one.metadata, getattr(self, one.name, None)
            low, high = described.get("low"), described.get("high")
            if described.get("choices") and value not in described["choices"]:
                raise SettingsError(f"{one.name} {value!r}: allowed {', '.join(described['choices'])}")
            if isinstance(value, int | float) and low is not None and high is not None and not low <= value <= high:
                raise SettingsError(f"{one.name} {value:g}: allowed {low:g} to {high:g} {described['unit']}".strip())
