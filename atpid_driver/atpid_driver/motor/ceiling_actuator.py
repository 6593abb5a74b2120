# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The protocol that every ceiling implements. Heights are floor to ceiling [m], times integer nanoseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from typing import Protocol, runtime_checkable

from atpid_common.injected_faults import Injected
from atpid_common.vocabulary import Mode
from atpid_driver.motor.faults import NO_FAULT, HeightRefusedError, LimitsError, MotorFault


@dataclass(frozen=True, slots=True)
class Limits:
    """Lowest and highest height [m] and the constant travelling speed [m/s]."""

    lowest: float
    highest: float
    speed: float

    def __post_init__(self) -> None:
        """Raise `LimitsError` for limits that are not possible."""
        if not 0.0 < self.lowest < self.highest < float("inf"):
            raise LimitsError(
                f"ceiling limits lowest {self.lowest:g} m, highest {self.highest:g} m: need 0 < lowest < highest; "
                "the lowest is the grain's diameter"
            )
        if not 0.0 < self.speed < float("inf"):
            raise LimitsError(
                f"ceiling speed {self.speed:g} m/s: must be above 0; give the speed measured at the stand"
            )

    def check(self, height: float) -> float:
        """Return `height` [m] if it is allowed, else raise `HeightRefusedError`."""
        if not self.lowest <= height <= self.highest:
            raise HeightRefusedError(
                f"ceiling height {height:g} m refused: allowed {self.lowest:g} to {self.highest:g} m; the ceiling "
                "stays, command a height inside the limits"
            )
        return height


@dataclass(frozen=True, slots=True)
class Reading:
    """The state of the ceiling at one instant; NaN: unknown or nowhere."""

    mode: Mode
    homed: bool = False
    faults: MotorFault = NO_FAULT
    height: float = nan
    target: float = nan
    velocity: float = 0.0
    speed: float = 0.0
    sequence: int = 0
    time: float = field(default=nan, compare=False)  # when, by the board's own clock; NaN: it is of now [s]
    steady: float = field(default=nan, compare=False)  # the same by the host's steady clock [s]

    @property
    def ready(self) -> bool:
        """Whether a height can be commanded."""
        return self.homed and self.mode in (Mode.HOLDING, Mode.MOVING)


@runtime_checkable
class CeilingActuator(Protocol):
    """A ceiling that travels to a height at constant speed.

    Sequence: `connect` (identify; motor off) → `activate` (arm and home) → `move`, `read` → `deactivate` (motor off)
    → `close`.
    `now` is the time the call stands for [ns]: the simulated ceiling moves by it alone, a real one has its own clock.
    """

    @property
    def limits(self) -> Limits:
        """Limits in force."""

    @property
    def placed(self) -> bool:
        """Whether it can find by itself where it stands; a simulated ceiling may have to be placed."""

    @property
    def true_height(self) -> float:
        """Where it really stands [m]; NaN: not known, as of a real one, which has its readings alone."""

    def place(self, height: float, now: int) -> None:
        """Put a simulated ceiling at `height` [m]. Raises `NotReadyError` for a real one."""

    def with_faults(self, faults: Sequence[Injected], now: int) -> CeilingActuator:
        """Return the ceiling with these injected faults and no others, whose times are those of `now`.

        Raises `SettingsError` for a real one.
        """

    def connect(self, now: int) -> str:
        """Open; return kind and firmware version, the motor being off. Raises `LinkError` or `IdentityError`."""

    def activate(self, now: int) -> None:
        """Arm and start homing. Raises `NotReadyError` if it cannot be armed."""

    def deactivate(self, now: int) -> None:
        """Stop at once and disarm: motor off. Raises `StopNotConfirmedError` where a real one does not confirm it."""

    def move(self, height: float, sequence: int, now: int) -> None:
        """Travel to `height` [m]; NaN: stop and stay.

        Raises `HeightRefusedError` or `NotReadyError`; the ceiling then keeps its previous target.
        """

    def read(self, now: int) -> Reading:
        """Return the state at `now`. Reading keeps the heartbeat alive: without it the motor is switched off."""

    def observe(self, now: int) -> Reading:
        """Return the state at `now` without keeping the heartbeat alive: 500 ms after the last `read` it is a fault."""

    def reports(self) -> list[str]:
        """Return the events of the link since the last call, one line each: lost, restored, a late refusal."""

    def health(self) -> dict[str, str]:
        """Return what diagnostics show of the connection: `hardware_id`, counters, `last error`."""

    def close(self) -> None:
        """Switch the motor off and close the connection."""
