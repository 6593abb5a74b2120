# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor node, declared and checked in one place.

Limits and speed have no defaults: they belong into the parameter file.
"""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field
from math import isfinite, nan
from typing import Any, Final

from atpid_common.injected_faults import CEILING, Injected, overlapping, parsed
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.errors import SettingsError
from atpid_driver.motor.known_motion import check_distance

BACKENDS: Final = ("simulated", "serial")


def described(
    description: str, unit: str = "", low: float | None = None, high: float | None = None, *,
    default: Any = MISSING, **more: Any,
) -> Any:  # fmt: skip
    """Return a field that is a parameter of the node: meaning, unit, range; without a default it must be set.

    more: `choices`, and whether it may change `live`. The node's table and docs/parameters.md follow from it.
    """
    metadata = {"description": description, "unit": unit, "low": low, "high": high}
    return field(default=default, metadata=metadata | more)


@dataclass(frozen=True, slots=True)
class MotorSettings:
    """Parameters of the motor node, SI units."""

    backend: str = described("what moves the ceiling", choices=BACKENDS)
    lowest: float = described("lowest ceiling height, the grain's diameter", "m", 0.0, 10.0)
    highest: float = described("highest ceiling height", "m", 0.0, 10.0)
    speed: float = described("constant travelling speed", "m/s", 0.0, 100.0)
    initial_height: float = described(
        "where a real ceiling goes after homing, NaN: it stays; where a simulated one stands, NaN: where that of the "
        "simulated plant stands",
        "m",
        default=nan,
    )
    lockstep: bool = described(
        "answer each command with one state by its stamp instead of publishing on an own period", default=False
    )
    autostart: bool = described("configure and activate without a lifecycle manager", default=True)
    rate: float = described(
        "states published per second, and heartbeat rate; not used in lockstep", "Hz", 10.0, 200.0, default=50.0
    )
    command_timeout: float = described(
        "a command that waited longer is ignored; not used in lockstep", "s", 0.01, 10.0, default=0.5
    )
    stale_timeout: float = described(
        "silence of ceiling/command after which the ceiling is stopped; not used in lockstep",
        "s",
        0.1,
        60.0,
        default=0.4,
    )
    commander: str = described(
        "name of the only node whose commands are followed; empty: of any, one at a time", default=""
    )
    faults: Sequence[str] = described(
        "injected faults of a simulated ceiling: 'PART KIND FROM TO [VALUE]' (docs/faults.md); "
        "empty: none; refused with backend serial",
        default=("",),
        live=True,
    )
    supervised: bool = described(
        "move, and send heartbeats, only while the supervisor permits it; not used in lockstep", default=False
    )
    supervision_timeout: float = described(
        "silence of the supervisor that withdraws its permission", "s", 0.1, 10.0, default=0.3
    )
    check_move: float = described(
        "before a run the ceiling moves by this distance and back: direction, distance and speed are checked; 0: none",
        "m",
        0.0,
        10.0,
        default=0.0,
    )
    port: str = described("serial port of the board by its stable name, /dev/serial/by-id/...", default="")
    baud: int = described("baud rate of the serial port", default=250_000)
    identify_timeout: float = described(
        "how long to request the board's identity; a reset by opening takes about 2 s", "s", 0.1, 60.0, default=5.0
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
        for name in ("rate", "command_timeout", "stale_timeout", "identify_timeout", "supervision_timeout", "baud"):
            value = float(getattr(self, name))
            if not (isfinite(value) and value > 0.0):
                raise SettingsError(f"{name} {value:g}: must be a number above 0")
        if self.backend == "serial" and not self.port:
            raise SettingsError("port is empty: give the board's stable name, /dev/serial/by-id/...")
        if self.backend == "serial" and self.lockstep:
            raise SettingsError("lockstep with backend serial: a real motor has its own clock; set lockstep: false")
