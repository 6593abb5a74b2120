# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ceiling that moves at constant speed between its limits (thesis Eq. 3.36), exact and advanced by time stamps alone.

A travel is kept as its start, not summed step by step, so any sequence of readings gives the same heights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, isnan, nan

from atpid_common.injected_faults import Injected
from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor.ceiling_actuator import Limits, Reading, SimulatedCeiling
from atpid_driver.motor.faults import HEARTBEAT_TIME, NO_FAULT, MotorFault
from atpid_driver.motor.simulated_faults import FaultyActuator

NANO = 1e-9


@dataclass(frozen=True, slots=True)
class Travel:
    """One straight travel: from `origin` [m] at `start` [ns] to `target` [m] at `speed` [m/s]."""

    start: int
    origin: float
    target: float
    speed: float

    def height(self, now: int) -> float:
        """Return the height [m] at `now` [ns]; the target exactly once it is reached, the origin before the start."""
        distance = self.target - self.origin
        travelled = self.speed * max(0, now - self.start) * NANO
        if travelled >= abs(distance):
            return self.target
        return self.origin + copysign(travelled, distance)


class SimulatedActuator(SimulatedCeiling):
    """The simulated backend of `CeilingActuator`: always there, homed as soon as it is armed and placed."""

    NAME = "simulated ceiling"

    def __init__(self, limits: Limits, initial_height: float) -> None:
        """Stand at `initial_height` [m], NaN: unknown until `place`.

        Raises `HeightRefusedError` if it is outside the limits.
        """
        self.limits = limits
        self._travel = self._rest(nan if isnan(initial_height) else limits.check(initial_height), 0)
        self._sequence = self._latest = 0

    @property
    def true_height(self) -> float:
        """Where it stood when it was last asked [m]."""
        return self._travel.height(self._latest)

    def with_faults(self, faults: Sequence[Injected], now: int) -> "SimulatedActuator | FaultyActuator":
        """Return a ceiling with these faults that goes on from where this one is; without any, itself."""
        if not faults:
            return self
        reading = self.read(now)
        faulty = FaultyActuator(self.limits, reading.height, faults)
        faulty.continue_from(reading, now)
        return faulty

    @property
    def placed(self) -> bool:
        """Whether it is known where the ceiling stands."""
        return not isnan(self._travel.origin)

    def place(self, height: float, now: int) -> None:
        """Stand at `height` [m], wherever that is: limits are those of commands."""
        self._travel, self._latest = self._rest(height, now), now

    def move(self, height: float, sequence: int, now: int) -> None:
        """Travel to `height` [m] from where the ceiling is at `now` [ns]; NaN: stop there and stay."""
        if self._mode is not Mode.HOLDING:
            raise NotReadyError(
                f"ceiling height {height:g} m refused: the motor is {self._mode.name.lower()}; activate it"
            )
        here = self._height(now)
        if not self.placed:
            raise NotReadyError(f"ceiling height {height:g} m refused: it is not known yet where the ceiling stands")
        goal = here if isnan(height) else self.limits.check(height)
        self._sequence = sequence
        if goal != self._travel.target:
            self._travel = Travel(now, here, goal, self.limits.speed)

    def _state(self, now: int) -> Reading:
        height, target = self._height(now), self._travel.target
        armed = self._mode is Mode.HOLDING
        if armed and not self.placed:
            return Reading(mode=Mode.HOMING, speed=self.limits.speed)
        moving = armed and height != target
        return Reading(
            mode=Mode.MOVING if moving else self._mode,
            homed=armed,
            faults=MotorFault.HEARTBEAT if self._mode is Mode.FAULT else NO_FAULT,
            height=height,
            target=target if armed else nan,
            velocity=copysign(self.limits.speed, target - height) if moving else 0.0,
            speed=self.limits.speed,
            sequence=self._sequence,
        )

    def _lose_heartbeat(self) -> None:
        self._halt(self._alive + HEARTBEAT_TIME, Mode.FAULT)

    def _halt(self, now: int, mode: Mode) -> None:
        self._travel = self._rest(self._height(now), now)
        self._mode = mode

    def _height(self, now: int) -> float:
        """Return the height at `now`; a clock that was set back moves nothing: the travel goes on from where it is."""
        if now < self._latest:
            here = self._travel.height(self._latest)
            self._travel = Travel(now, here, self._travel.target, self.limits.speed)
        self._latest = now
        return self._travel.height(now)

    def _rest(self, height: float, now: int) -> Travel:
        return Travel(now, height, height, self.limits.speed)
