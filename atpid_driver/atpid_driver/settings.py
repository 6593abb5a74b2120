# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes that move something: each is declared once, with its meaning, unit and range."""

from dataclasses import dataclass

from atpid_common.parameters import problem_of, setting
from atpid_driver import SettingsError


@dataclass(frozen=True, kw_only=True)
class SupervisedSettings:
    """What the nodes of motor and exciter have in common, SI units."""

    rate: float
    stale_timeout: float
    lockstep: bool = setting(
        False, "answer each message with one state at its stamp instead of publishing on an own period"
    )
    autostart: bool = setting(True, "configure and activate without a lifecycle manager")
    command_timeout: float = setting(
        0.5, "a command that waited longer is ignored; not used in lockstep", "s", 0.01, 10.0
    )
    commander: str = setting("", "name of the only node whose commands are followed; empty: of any, one at a time")
    supervised: bool = setting(False, "move only while the supervisor permits it; not used in lockstep")
    supervision_timeout: float = setting(0.3, "silence of the supervisor that withdraws its permission", "s", 0.1, 10.0)

    def __post_init__(self) -> None:
        """Raise `SettingsError` for a value outside its range or choices."""
        if problem := problem_of(self):
            raise SettingsError(problem)
