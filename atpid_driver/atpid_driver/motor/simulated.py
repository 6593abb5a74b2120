# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ceiling that moves at constant speed between its limits (thesis Eq. 3.36), exact and advanced by time stamps alone.

A travel is kept as its start, not summed step by step, so any sequence of readings gives the same heights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, expm1, isnan, nan

import numpy as np

from atpid_common.injected_faults import TO_THE_SWITCH, Injected, active_fault
from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor.ceiling_actuator import Limits, Reading
from atpid_driver.motor.faults import HEARTBEAT_TIME, NO_FAULT, MotorFault, in_words

_STEP_NS = 1_000_000
_STEP = _STEP_NS * 1e-9  # [s]
#: No more than this is computed at once [ns]: a clock that was set is no time that passed.
_LONGEST = 10_000_000_000
#: A motor that is on and moves the reading less than this in so long stalls [m], [s].
_STALL, _STALL_TIME = 0.003, 0.3
#: Steps of the reading, moves against the command and moves with the motor off that are no motion of this motor [m].
_JUMP = 0.005
#: How long a move may take: its distance over the speed times this, and so much more [-], [s].
_OVERTIME, _OVERTIME_MORE = 1.5, 0.5
#: How long a random direction of the motor lasts [s].
_DIRECTION = 0.1


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
        travelled = self.speed * max(0, now - self.start) * 1e-9
        if travelled >= abs(distance):
            return self.target
        return self.origin + copysign(travelled, distance)


class SimulatedActuator:
    """The simulated backend of `CeilingActuator`: always there, homed as soon as it is armed and placed.

    It has no link; its motor is off 500 ms after the last heartbeat.
    """

    NAME = "simulated ceiling"
    _mode = Mode.UNCONFIGURED
    _alive = 0  # the last heartbeat [ns]

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

    def with_faults(self, faults: Sequence[Injected], now: int) -> "SimulatedActuator":
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
        return not isnan(self.true_height)

    def place(self, height: float, now: int) -> None:
        """Stand at `height` [m], wherever that is: limits are those of commands."""
        self._travel, self._latest = self._rest(height, now), now

    def connect(self, now: int) -> str:
        """Return what it is: a simulated ceiling."""
        self._halt(now, Mode.DISARMED)
        return f"{self.NAME} 1"

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

    def read(self, now: int) -> Reading:
        """Return the state at `now` [ns]."""
        self._alive = now
        return self._state(now)

    def observe(self, now: int) -> Reading:
        """Return the same without a heartbeat: the motor is off where none came for 500 ms, until it is armed."""
        if self._mode is Mode.HOLDING and now - self._alive > HEARTBEAT_TIME:
            self._lose_heartbeat()
        return self._state(now)

    def reports(self) -> list[str]:
        """Return none: it has no link."""
        return []

    def health(self) -> dict[str, str]:
        """Return its name; there is no link."""
        return {"hardware_id": self.NAME}

    def close(self) -> None:
        """Close."""
        self._mode = Mode.UNCONFIGURED

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
        height, target, direction, faults = self._motion(now)
        mode, armed = self._mode, self._mode is Mode.HOLDING
        if armed and not self.placed:
            return Reading(mode=Mode.HOMING, speed=self.limits.speed)
        if armed and (faults or direction):
            mode = Mode.FAULT if faults else Mode.MOVING
        return Reading(
            mode=mode,
            homed=armed,
            faults=faults,
            height=height,
            target=target if mode in (Mode.HOLDING, Mode.MOVING) else nan,
            velocity=direction * self.limits.speed if mode is Mode.MOVING else 0.0,
            speed=self.limits.speed,
            sequence=self._sequence,
        )

    def _motion(self, now: int) -> tuple[float, float, float, MotorFault]:
        """Return at `now` [ns] height and target [m], direction (1: up, -1, 0: at rest), and faults."""
        height, target = self._height(now), self._travel.target
        direction = 0.0 if height == target else copysign(1.0, target - height)
        return height, target, direction, MotorFault.HEARTBEAT if self._mode is Mode.FAULT else NO_FAULT

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


class FaultyActuator(SimulatedActuator):
    """A simulated ceiling with injected faults of `motor` and `height_sensor`; latched faults need `activate`."""

    NAME = "simulated ceiling with injected faults"
    true_height = nan  # [m]

    def __init__(self, limits: Limits, initial_height: float, faults: Sequence[Injected]) -> None:
        """Stand at `initial_height` [m], NaN: unknown until `place`. Times of `faults` are those of `now`."""
        self.limits = limits
        self._injected = tuple(faults)
        self._random = np.random.default_rng(0)
        self.true_height = initial_height
        self._reading = self._lagging = self._target = initial_height
        self._past: list[float] = []  # true heights, one a step
        self._faults, self._sequence, self._now = NO_FAULT, 0, -1
        self._on, self._direction, self._driven, self._chosen = False, 1.0, 0.0, 1.0
        self._running = self._allowed = 0.0  # how long the motor is on, and may be [s]
        self._origin = self._mark = initial_height  # reading when the motor was switched; that a stall is judged by

    def with_faults(self, faults: Sequence[Injected], now: int) -> "FaultyActuator":
        """Return itself, with these faults from now on and no others; their times are those of `now`."""
        self._injected = tuple(faults)
        return self

    def continue_from(self, reading: Reading, now: int) -> None:
        """Go on as another simulated ceiling, by its reading at `now` [ns]: in its mode, on its way to its target."""
        self._now = self._alive = now
        self._faults = reading.faults
        self._mode = reading.mode if reading.mode in (Mode.UNCONFIGURED, Mode.DISARMED) else Mode.HOLDING
        if reading.mode is Mode.MOVING:
            self.move(reading.target, reading.sequence, now)
        self._sequence = reading.sequence

    def place(self, height: float, now: int) -> None:
        """Stand at `height` [m]."""
        self.true_height = self._reading = self._lagging = self._target = self._origin = height
        self._now = now

    def activate(self, now: int) -> None:
        """Arm, with latched faults cleared; raise NotReadyError where the cause is still there."""
        self._advance(now)
        if self._mode is not Mode.UNCONFIGURED and self.placed and isnan(self._reading):
            raise NotReadyError(f"not armed: {in_words(MotorFault.SENSOR_LOW)}")
        super().activate(now)
        self._faults = NO_FAULT

    def move(self, height: float, sequence: int, now: int) -> None:
        """Travel to `height` [m] as the sensor reads it; NaN: stop there and stay."""
        self._advance(now)
        if self._mode is not Mode.HOLDING or self._faults or not self.placed:
            state = "fault latched" if self._faults else self._mode.name.lower()
            raise NotReadyError(f"ceiling height {height:g} m refused: the motor is {state}; activate it")
        goal = self._reading if isnan(height) else self.limits.check(height)
        self._sequence = sequence
        if goal == self._target:
            return
        self._target = goal
        distance = goal - self._reading
        self._on, self._direction = abs(distance) > self.limits.speed * _STEP, copysign(1.0, distance)
        self._origin = self._mark = self._reading
        self._running, self._allowed = 0.0, _OVERTIME * abs(distance) / self.limits.speed + _OVERTIME_MORE

    def _lose_heartbeat(self) -> None:
        self._faults |= MotorFault.HEARTBEAT

    def _motion(self, now: int) -> tuple[float, float, float, MotorFault]:
        """Return the same as the height sensor reads it."""
        self._advance(now)
        return self._reading, self._target, self._direction if self._on else 0.0, self._faults

    def close(self) -> None:
        """Close."""
        super().close()
        self._on = False

    def _halt(self, now: int, mode: Mode) -> None:
        self._advance(now)
        self._on, self._mode = False, mode
        self._target = self._origin = self._reading

    # motion and sensor

    def _advance(self, now: int) -> None:
        if not self.placed or not 0 <= now - self._now <= _LONGEST:
            self._now = now
        while now - self._now >= _STEP_NS:
            self._now += _STEP_NS
            self._step(self._now * 1e-9)

    def _step(self, time: float) -> None:
        velocity = self._velocity(time)
        # there a switch cuts the motor's supply, whatever drives it; below, the grain holds the ceiling
        top = self.limits.highest + TO_THE_SWITCH
        self.true_height = min(max(self.true_height + velocity * _STEP, self.limits.lowest), top)
        delayed = any(fault.part == "height_sensor" and fault.kind == "delayed" for fault in self._injected)
        self._past = [*self._past[-20_000:], self.true_height] if delayed else []
        before, self._reading = self._reading, self._sensed(time)
        if self._mode is not Mode.HOLDING:
            return
        self._running = self._running + _STEP if self._on else 0.0
        self._faults |= self._found(before)
        arrived = (self._target - self._reading) * self._direction <= 0.0
        if self._on and (arrived or self._faults):
            self._on, self._origin = False, self._reading
            if arrived:
                self._origin = self._target

    def _velocity(self, time: float) -> float:
        """Return how the ceiling really moves [m/s]."""
        fault = active_fault(self._injected, time, "motor")
        usual = self._direction * self.limits.speed if self._on else 0.0
        kind = fault.kind if fault else ""
        if kind == "stuck":
            self._driven = usual or self._driven
            return self._driven
        self._driven = 0.0
        if fault is None:
            return usual
        if kind == "garbage" and round(self._running / _STEP) % round(_DIRECTION / _STEP) == 0:
            self._chosen = float(self._random.choice((-1.0, 1.0)))
        late = self._running < fault.value if kind == "delayed" else False
        factor = {"off": 0.0, "wrong": -1.0, "slow": fault.value, "garbage": self._chosen}
        return 0.0 if late or fault.gap(time) else usual * factor.get(kind, 1.0)

    def _sensed(self, time: float) -> float:
        """Return what the height sensor reads [m]; NaN: nothing."""
        fault, true = active_fault(self._injected, time, "height_sensor"), self.true_height
        if fault is None or fault.kind != "slow":
            self._lagging = true
        if fault is None:
            return true
        if fault.kind == "slow":
            self._lagging -= expm1(-_STEP / fault.value) * (true - self._lagging)
        back = round(fault.value / _STEP) if fault.kind == "delayed" else 0
        readings = {
            "off": nan,
            "stuck": self._reading,
            "garbage": float(self._random.uniform(self.limits.lowest, self.limits.highest)),
            "wrong": true + fault.value,
            "slow": self._lagging,
            "delayed": self._past[-min(back + 1, len(self._past))] if self._past else true,
            "intermittent": nan if fault.gap(time) else true,
        }
        return readings[fault.kind]

    # the checks, which the firmware makes too

    def _found(self, before: float) -> MotorFault:
        found, reading, origin = NO_FAULT, self._reading, self._origin
        if isnan(reading):
            return MotorFault.SENSOR_LOW
        if abs(reading - before) > _JUMP:
            found |= MotorFault.SENSOR_JUMP
        if not self._on:
            return found | (MotorFault.UNCOMMANDED if abs(reading - origin) > _JUMP else NO_FAULT)
        if (reading - origin) * self._direction < -_JUMP:
            found |= MotorFault.WRONG_WAY
        if self._running > self._allowed:
            found |= MotorFault.OVERTIME
        window = round(_STALL_TIME / _STEP)
        if round(self._running / _STEP) % window == 0:
            near = abs(self._target - reading) < _STALL
            found |= MotorFault.STALL if abs(reading - self._mark) < _STALL and not near else NO_FAULT
            self._mark = reading
        return found
