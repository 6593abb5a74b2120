# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor node, checked in one place.

Limits and speed have no defaults: they belong into the parameter file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite, nan

from atpid_common.injected_faults import CEILING, LINK, Injected, overlapping, parsed
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.errors import SettingsError
from atpid_driver.motor.known_motion import check_distance


@dataclass(frozen=True, slots=True)
class MotorSettings:
    """Parameters of the motor node, SI units."""

    backend: str
    lowest: float
    highest: float
    speed: float
    initial_height: float = nan
    lockstep: bool = False
    autostart: bool = True
    rate: float = 50.0
    command_timeout: float = 0.5
    stale_timeout: float = 0.4
    commander: str = ""  # name of the only node that may command; empty: any
    port: str = ""
    baud: int = 250000
    identify_timeout: float = 5.0
    faults: Sequence[str] = ()  # to act: PART KIND FROM TO [VALUE]
    supervised: bool = False
    supervision_timeout: float = 0.3
    check_move: float = 0.0  # 0: none
    limits: Limits = field(init=False)
    injected: tuple[Injected, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Raise `SettingsError` or a subclass for a value that cannot be."""
        object.__setattr__(self, "limits", Limits(self.lowest, self.highest, self.speed))
        parts, where = (CEILING, "the simulated motor") if self.backend == "simulated" else (LINK, "the board's link")
        object.__setattr__(self, "injected", parsed(self.faults, parts, where))
        if both := overlapping(self.injected):
            raise SettingsError(f"faults: given {both[0]} and {both[1]}; allowed: one fault of a part at a time")
        if isfinite(self.initial_height):
            self.limits.check(self.initial_height)
        check_distance(self.check_move, self.limits)
        if self.check_move and self.lockstep:
            raise SettingsError(
                f"check_move {self.check_move:g} m in lockstep: nothing moves before a run; set it to 0"
            )
        for name in ("rate", "command_timeout", "stale_timeout", "identify_timeout", "supervision_timeout", "baud"):
            value = float(getattr(self, name))
            if not (isfinite(value) and value > 0.0):
                raise SettingsError(f"{name} {value:g}: must be a number above 0")
        if self.backend == "serial" and not self.port:
            raise SettingsError("port is empty: give the board's stable name, /dev/serial/by-id/...")
        if self.backend == "serial" and self.lockstep:
            raise SettingsError("lockstep with backend serial: a real motor has its own clock; set lockstep: false")
