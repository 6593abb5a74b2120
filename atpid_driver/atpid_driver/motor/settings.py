# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor node. Limits and speed have no defaults: they belong into the parameter file."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from math import isfinite, nan
from typing import Final

from atpid_common.injected_faults import CEILING, Injected, overlapping, parsed
from atpid_common.parameters import setting
from atpid_driver import SettingsError
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.known_motion import check_distance
from atpid_driver.settings import SupervisedSettings

BUILT_IN: Final = ("simulated", "serial")
#: Group of the entry points that add a drive: its name, and what returns a `CeilingActuator` for these settings.
DRIVES: Final = "atpid.drives"
BACKENDS: Final = (*BUILT_IN, *sorted(entry_points(group=DRIVES).names - {*BUILT_IN}))


@dataclass(frozen=True, kw_only=True)
class MotorSettings(SupervisedSettings):
    """Parameters of the motor node, SI units."""

    backend: str = setting(str, "what moves the ceiling", choices=BACKENDS)
    lowest: float = setting(float, "lowest ceiling height, the grain's diameter", "m", 0.0, 10.0)
    highest: float = setting(float, "highest ceiling height", "m", 0.0, 10.0)
    speed: float = setting(float, "constant travelling speed", "m/s", 0.0, 100.0)
    initial_height: float = setting(
        nan,
        "where a real ceiling goes after homing, NaN: it stays; where a simulated one stands, NaN: where that of the "
        "simulated plant stands",
        "m",
    )
    rate: float = setting(
        50.0, "states published per second, and heartbeat rate; not used in lockstep", "Hz", 10.0, 200.0
    )
    stale_timeout: float = setting(
        0.4, "silence of ceiling/command after which the ceiling is stopped; not used in lockstep", "s", 0.1, 60.0
    )
    faults: Sequence[str] = setting(
        ("",),
        "injected faults of a simulated ceiling: 'PART KIND FROM TO [VALUE]' (docs/faults.md); "
        "empty: none; refused of a real one",
        live=True,
    )
    check_move: float = setting(
        0.0, "ceiling's move and back before a run: direction, distance and speed are checked; 0: none", "m", 0.0, 10.0
    )
    port: str = setting("", "serial port of the board by its stable name, /dev/serial/by-id/...")
    baud: int = setting(250_000, "baud rate of the serial port", "", 300, 2_000_000)
    identify_timeout: float = setting(
        5.0, "how long to request the board's identity; a reset by opening takes about 2 s", "s", 0.1, 60.0
    )
    limits: Limits = field(init=False)
    injected: tuple[Injected, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Raise `SettingsError` or a subclass for an invalid value."""
        object.__setattr__(self, "limits", Limits(self.lowest, self.highest, self.speed))
        if self.backend != "simulated" and any(self.faults):
            raise SettingsError(
                f"faults: given {', '.join(filter(None, self.faults))!r} with backend {self.backend}; allowed: none, a "
                "real motor is not disturbed; the emulated board has faults of its line (docs/faults.md)"
            )
        object.__setattr__(self, "injected", parsed(self.faults, CEILING, "the simulated motor"))
        if both := overlapping(self.injected):
            raise SettingsError(f"faults: given {both[0]} and {both[1]}; allowed: one fault of a part at a time")
        if isfinite(self.initial_height):
            self.limits.check(self.initial_height)
        check_distance(self.check_move, self.limits)
        if self.check_move and self.lockstep:
            raise SettingsError(
                f"check_move {self.check_move:g} m in lockstep: nothing moves before a run; set it to 0"
            )
        if self.backend == "serial" and not self.port:
            raise SettingsError("port is empty: give the board's stable name, /dev/serial/by-id/...")
        if self.backend != "simulated" and self.lockstep:
            raise SettingsError(
                f"lockstep with backend {self.backend}: a real motor has its own clock; set lockstep: false"
            )
        super().__post_init__()
