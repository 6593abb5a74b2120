# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The check of direction and gain before a run: the ceiling moves by a known distance and back (docs/graph.md)."""

from dataclasses import dataclass
from math import isnan, nan

from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, SettingsError
from atpid_driver.motor.ceiling_actuator import Limits, Reading
from atpid_driver.motor.faults import in_words

#: How far a height may be from the commanded one [m], and the speed from the given one [-].
HEIGHT_TOLERANCE, SPEED_TOLERANCE = 0.003, 0.25
#: The shortest travel by which 50 readings a second judge the speed [s].
_LEAST_TIME = 0.3
#: How long a travel may take: its distance over the speed times this, and so much more [-], [s].
_OVERTIME, _OVERTIME_MORE = 1.5, 1.0
#: From the announcement to the motion [s].
ANNOUNCED = 1.0
SAME = 1e-6  # a height on the wire is a whole number of micrometres [m]


class KnownMotionError(DriverError):
    """The ceiling did not move as it was commanded."""


def check_distance(distance: float, limits: Limits) -> None:
    """Raise `SettingsError` for a distance [m] that is not 0 (none) and cannot be judged or may not fit."""
    low, high = _LEAST_TIME * limits.speed, 0.5 * (limits.highest - limits.lowest)
    if distance != 0.0 and not low <= distance <= high:
        why = f"{_LEAST_TIME:g} s at {limits.speed:g} m/s, to half the range"
        raise SettingsError(f"check_move {distance:g} m: allowed 0 (none) or {low:g} to {high:g} m ({why})")


@dataclass
class _Travel:
    """One travel at `speed` [m/s], from `origin` to `target` [m], commanded at `begun` [s].

    The times of the readings are bounds of its duration, however few there are.
    """

    origin: float
    target: float
    speed: float
    begun: float
    _last_at_origin: float = nan  # NaN: when it was commanded
    _first_between: float = nan
    _last_between: float = nan
    _first_at_target: float = nan

    def done(self, reading: Reading, now: float) -> bool:
        """Take a reading of `now` [s]; return whether the ceiling has arrived. Raises `KnownMotionError`."""
        moved, wanted = reading.height - self.origin, self.target - self.origin
        if not reading.ready:
            found = f"the motor is off: {in_words(reading.faults) or reading.mode.name.lower()}"
            raise self._error(f"{wanted:+.3f} m", found, "remove the cause")
        if moved * wanted < 0.0 and abs(moved) > HEIGHT_TOLERANCE:
            raise self._error(f"{wanted:+.3f} m", f"{moved:+.3f} m", "swap the motor's leads or the height sensor's")
        if abs(moved) <= HEIGHT_TOLERANCE and isnan(self._first_between):
            self._last_at_origin = now
        elif abs(reading.height - self.target) > HEIGHT_TOLERANCE:
            self._first_between = now if isnan(self._first_between) else self._first_between
            self._last_between = now
        elif isnan(self._first_at_target):
            self._first_at_target = now
        if reading.mode is Mode.HOLDING and abs(reading.target - self.target) < SAME:
            self._judge(reading.height, now)
            return True
        allowed = _OVERTIME * abs(wanted) / self.speed + _OVERTIME_MORE
        if now - self.begun > allowed:
            raise self._error(f"{wanted:+.3f} m within {allowed:.1f} s", f"{moved:+.3f} m", "free the ceiling")
        return False

    def _judge(self, height: float, now: float) -> None:
        moved, wanted = height - self.origin, self.target - self.origin
        if abs(moved - wanted) > HEIGHT_TOLERANCE:
            expected = f"{wanted:+.3f} m within {HEIGHT_TOLERANCE * 1e3:g} mm"
            raise self._error(expected, f"{moved:+.3f} m", "calibrate the height sensor")
        if abs(wanted) < _LEAST_TIME * self.speed:
            return  # the way back to where an interrupted motion began
        usual = (abs(wanted) - 2.0 * HEIGHT_TOLERANCE) / self.speed  # both ends left out
        left = self.begun if isnan(self._last_at_origin) else self._last_at_origin
        longest = (now if isnan(self._first_at_target) else self._first_at_target) - left
        shortest = 0.0 if isnan(self._first_between) else self._last_between - self._first_between
        expected = f"{self.speed:g} m/s within {SPEED_TOLERANCE:.0%}"
        remedy = "measure the speed and calibrate the height sensor"
        if shortest > usual / (1.0 - SPEED_TOLERANCE):
            raise self._error(expected, f"at most {usual * self.speed / shortest:.3f} m/s", remedy)
        if longest < usual / (1.0 + SPEED_TOLERANCE):
            raise self._error(expected, f"at least {usual * self.speed / max(longest, 1e-3):.3f} m/s", remedy)

    def _error(self, expected: str, found: str, remedy: str) -> KnownMotionError:
        commanded = f"commanded {self.origin:.3f} to {self.target:.3f} m"
        return KnownMotionError(f"known motion: {commanded}; expected {expected}, found {found}; {remedy}")


class KnownMotion:
    """Moves the ceiling by `distance` [m], up where there is room, and back; a distance of 0 has passed."""

    def __init__(self, distance: float, limits: Limits) -> None:
        self._distance, self._limits = distance, limits
        self._origin = self._announced = nan
        self._heights: list[float] = []  # still to go to [m]
        self._travel: _Travel | None = None
        self.passed = distance == 0.0

    @property
    def announced(self) -> bool:
        """Whether it has begun."""
        return not isnan(self._announced)

    def restart(self) -> None:
        """Begin again at the next turn: the motion was interrupted."""
        self._announced, self._heights, self._travel = nan, [], None

    def announcement(self, height: float, now: float) -> str:
        """Return what is going to happen from `height` [m] on, at the first call; empty afterwards. `now`: [s]."""
        if self.announced:
            return ""
        low, high = self._limits.lowest, self._limits.highest
        self._origin = origin = min(max(height, low), high) if isnan(self._origin) else self._origin
        away = origin + self._distance if origin + self._distance <= high else origin - self._distance
        interrupted = abs(height - origin) > HEIGHT_TOLERANCE
        self._announced, self._heights = now, [*([origin] if interrupted else []), away, origin]
        return f"known motion: in {ANNOUNCED:g} s the ceiling moves from {origin:.3f} to {away:.3f} m and back"

    def turn(self, reading: Reading, now: float) -> float:
        """Take a reading at `now` [s] after the announcement; return the height to command now, NaN: none [m].

        A board's readings are timed by its own clock: they may come late.
        Raises `KnownMotionError` where the ceiling did not move as commanded.
        """
        time = now if isnan(reading.time) else reading.time
        if self._travel is not None and not self._travel.done(reading, time):
            return nan
        if self._travel is None and now - self._announced < ANNOUNCED:
            return nan
        if not self._heights:
            self.passed = True
            return nan
        height = self._heights.pop(0)
        self._travel = _Travel(reading.height, height, self._limits.speed, time)
        return height
