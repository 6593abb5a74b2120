# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests that the drive of every ceiling must pass; the motor of each may move nothing unless it is armed.

Subclass `CeilingContract` in a test file; pytest then runs them on the ceiling that `make` returns.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from math import inf, isnan, nan

import pytest

from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Reading
from atpid_driver.motor.faults import HEARTBEAT_TIME, HeightRefusedError

#: How long homing or a travel may take, in the ceiling's own time [s].
LONGEST = 20.0


class CeilingContract:
    """What `CeilingActuator` promises without a fault of the device."""

    #: How finely it is known where the ceiling stands [m].
    resolution = 1e-9

    def make(self) -> CeilingActuator:
        """Return a ceiling, not connected, whose whole travel takes 2 to 10 s."""
        raise NotImplementedError

    def after(self, seconds: float) -> int:
        """Let `seconds` of the ceiling's time pass; return the time then [ns]."""
        time.sleep(seconds)
        return time.monotonic_ns()

    @pytest.fixture
    def ceiling(self) -> Iterator[CeilingActuator]:
        """Return a ceiling, connected."""
        with closing(self.make()) as made:
            assert made.connect(self.after(0.0))
            yield made

    @pytest.fixture
    def armed(self, ceiling: CeilingActuator) -> CeilingActuator:
        """Return it armed and homed, at its highest."""
        ceiling.activate(self.after(0.0))
        self.until(ceiling, lambda reading: reading.ready)
        self.travel(ceiling, ceiling.limits.highest, 1)
        return ceiling

    def until(self, ceiling: CeilingActuator, condition: Callable[[Reading], object]) -> Reading:
        """Read until a condition holds; return that reading."""
        for _ in range(round(LONGEST / 0.02)):
            reading = ceiling.read(self.after(0.02))
            if condition(reading):
                return reading
        pytest.fail(f"still {reading} after {LONGEST:g} s")

    def travel(self, ceiling: CeilingActuator, height: float, sequence: int) -> Reading:
        """Travel to a height; return the reading there."""
        ceiling.move(height, sequence, self.after(0.0))
        return self.until(ceiling, lambda reading: reading.mode is Mode.HOLDING and reading.sequence == sequence)

    def on_its_way(self, ceiling: CeilingActuator) -> Reading:
        """Send it down; return a reading on the way."""
        limits = ceiling.limits
        ceiling.move(limits.lowest, 7, self.after(0.0))
        begun = limits.highest - 0.05 * (limits.highest - limits.lowest)
        return self.until(ceiling, lambda reading: reading.height < begun)

    def stands(self, ceiling: CeilingActuator) -> float:
        """Return the height at which it is at rest; fail where it moves, observed without a heartbeat."""
        first, later = (ceiling.observe(self.after(0.1)).height for _ in range(2))
        assert isnan(first) or first == pytest.approx(later, abs=self.resolution)
        return later

    def test_connected_it_is_off_and_takes_no_height(self) -> None:
        """Neither before `connect` nor before `activate` does a command do anything."""
        with closing(self.make()) as made:
            assert made.read(self.after(0.0)).mode is Mode.UNCONFIGURED
            with pytest.raises(NotReadyError):
                made.move(made.limits.highest, 1, self.after(0.0))
            made.connect(self.after(0.0))
            assert made.read(self.after(0.0)).mode is Mode.DISARMED
            assert made.health()["hardware_id"]
            with pytest.raises(NotReadyError):
                made.move(made.limits.highest, 1, self.after(0.0))

    def test_it_travels_at_its_speed_and_states_where_it_is(self, armed: CeilingActuator) -> None:
        """The reading has the command's sequence and target, the velocity its sign; it arrives."""
        moving = self.on_its_way(armed)
        assert (moving.mode, moving.sequence) == (Mode.MOVING, 7)
        assert moving.velocity == -armed.limits.speed
        assert moving.target == armed.limits.lowest
        there = self.until(armed, lambda reading: reading.mode is Mode.HOLDING)
        assert there.height == pytest.approx(moving.target, abs=self.resolution)
        assert there.velocity == 0.0

    def test_nan_stops_it_where_it_is(self, armed: CeilingActuator) -> None:
        """NaN as a height stops it; it stays armed."""
        moving = self.on_its_way(armed)
        armed.move(nan, 8, self.after(0.0))
        there = self.until(armed, lambda reading: reading.mode is Mode.HOLDING and reading.sequence == 8)
        assert moving.target + self.resolution < there.height <= moving.height + self.resolution
        assert self.stands(armed) == pytest.approx(there.height, abs=self.resolution)

    def test_a_height_outside_the_limits_is_refused_and_it_stays(self, armed: CeilingActuator) -> None:
        """The refusal states the height; the last command stays in force."""
        before = armed.read(self.after(0.0))
        limits = armed.limits
        for height in (limits.lowest - 1e-4, limits.highest + 0.01, -1.0, inf, -inf):
            with pytest.raises(HeightRefusedError, match=f"{height:g} m"):
                armed.move(height, 9, self.after(0.0))
        after = armed.read(self.after(0.1))
        assert (after.mode, after.sequence) == (Mode.HOLDING, before.sequence)
        assert after.height == pytest.approx(before.height, abs=self.resolution)

    def test_deactivated_on_its_way_it_stops_and_is_off(self, armed: CeilingActuator) -> None:
        """When `deactivate` returns the motor is off; only `activate` arms it again."""
        moving = self.on_its_way(armed)
        armed.deactivate(self.after(0.0))
        reading = armed.read(self.after(0.0))
        assert (reading.mode, reading.velocity, isnan(reading.target)) == (Mode.DISARMED, 0.0, True)
        assert not self.stands(armed) < moving.target
        with pytest.raises(NotReadyError):
            armed.move(armed.limits.highest, 10, self.after(0.0))
        armed.activate(self.after(0.0))
        self.until(armed, lambda reading: reading.ready)

    def test_without_a_heartbeat_it_is_off(self, armed: CeilingActuator) -> None:
        """`observe` keeps nothing alive: the motor is off by itself when no `read` comes, and stays so."""
        self.on_its_way(armed)
        for _ in range(round(LONGEST)):
            last = armed.observe(self.after(2e-9 * HEARTBEAT_TIME))
            if last.faults:
                break
        assert (last.mode, bool(last.faults)) == (Mode.FAULT, True)
        self.stands(armed)
        with pytest.raises(NotReadyError):
            armed.move(armed.limits.highest, 11, self.after(0.0))

    def test_closed_it_is_off(self, armed: CeilingActuator) -> None:
        """`close` switches the motor off; connected again, it is disarmed."""
        self.on_its_way(armed)
        armed.close()
        assert armed.read(self.after(0.0)).mode is Mode.UNCONFIGURED
        armed.connect(self.after(0.0))
        assert armed.read(self.after(0.0)).mode is Mode.DISARMED
