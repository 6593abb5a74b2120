# SPDX-License-Identifier: Apache-2.0
"""A ceiling that moves at constant speed between its limits (thesis Eq. 3.36), exact and advanced by time stamps alone.

A travel is kept as its start, not summed step by step, so any sequence of readings gives the same heights.
"""

from dataclasses import dataclass
from math import copysign, isnan, nan

from atpid_driver.motor.ceiling_actuator import Identity, Limits, Mode, Reading
from atpid_driver.motor.errors import NotReadyError
from atpid_driver.motor.faults import HEARTBEAT_TIME, NO_FAULT, Fault

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


class SimulatedActuator:
    """The simulated backend of `CeilingActuator`: always there, homed as soon as it is armed and placed."""

    def __init__(self, limits: Limits, initial_height: float) -> None:
        """Stand at `initial_height` [m], NaN: unknown until `place`.

        Raises `HeightRefusedError` if it is outside the limits.
        """
        self.limits = limits
        self._travel = self._rest(nan if isnan(initial_height) else limits.check(initial_height), 0)
        self._mode, self._sequence, self._latest = Mode.UNCONFIGURED, 0, 0
        self._alive = 0  # the last heartbeat [ns]

    @property
    def placed(self) -> bool:
        """Whether it is known where the ceiling stands."""
        return not isnan(self._travel.origin)

    def place(self, height: float, now: int) -> None:
        """Stand at `height` [m], wherever that is: limits are those of commands."""
        self._travel, self._latest = self._rest(height, now), now

    def connect(self, now: int) -> Identity:
        """Return the identity of a simulated ceiling."""
        self._halt(now, Mode.DISARMED)
        return Identity("simulated ceiling", "1")

    def activate(self, now: int) -> None:
        """Arm; the height is known, so there is nothing to home."""
        if self._mode is Mode.UNCONFIGURED:
            raise NotReadyError("simulated ceiling not connected: connect it before it is activated")
        self._alive = now
        self._halt(now, Mode.HOLDING)

    def deactivate(self, now: int) -> None:
        """Stop where it is and disarm."""
        if self._mode is not Mode.UNCONFIGURED:
            self._halt(now, Mode.DISARMED)

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

    def read(self, now: int) -> Reading:
        """Return where the ceiling is at `now` [ns] and what it does next."""
        self._alive = now
        return self._state(now)

    def observe(self, now: int) -> Reading:
        """Return the same without a heartbeat: the motor is off where none came for 500 ms, until it is armed."""
        if self._mode is Mode.HOLDING and now - self._alive > HEARTBEAT_TIME:
            self._halt(self._alive + HEARTBEAT_TIME, Mode.FAULT)
        return self._state(now)

    def _state(self, now: int) -> Reading:
        height, target = self._height(now), self._travel.target
        armed = self._mode is Mode.HOLDING
        if armed and not self.placed:
            return Reading(mode=Mode.HOMING, speed=self.limits.speed)
        moving = armed and height != target
        return Reading(
            mode=Mode.MOVING if moving else self._mode,
            homed=armed,
            faults=Fault.HEARTBEAT if self._mode is Mode.FAULT else NO_FAULT,
            height=height,
            target=target if armed else nan,
            velocity=copysign(self.limits.speed, target - height) if moving else 0.0,
            speed=self.limits.speed,
            sequence=self._sequence,
        )

    def reports(self) -> list[str]:
        """Return none: it has no link."""
        return []

    def health(self) -> dict[str, str]:
        """Return its name; there is no link."""
        return {"hardware_id": "simulated ceiling"}

    def close(self) -> None:
        """Close."""
        self._mode = Mode.UNCONFIGURED

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
