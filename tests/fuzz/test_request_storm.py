# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A storm of random requests, a million with `make fuzz`: targets and heights keep their limits and speed."""

import math
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
import rclpy
from atpid_interfaces.msg import CeilingCommand, CeilingState
from builtin_interfaces.msg import Time
from hypothesis import settings
from rclpy.context import Context
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from atpid_common.injected_faults import CEILING, KINDS, TO_THE_SWITCH, Injected
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Limits
from atpid_driver.motor.simulated import FaultyActuator, SimulatedActuator
from atpid_driver.nodes.motor_node import MotorNode

LONG = settings.get_current_profile_name() == "long"
REQUESTS = 1_000_000 if LONG else 5_000
LIMITS = Limits(0.017, 1.0, 0.3)
#: Of a height by which a travel that is computed from another begin differs [m].
ROUNDING = 1e-9
ODD = (math.nan, math.inf, -math.inf, 0.0, -0.0, -1.0, 1e308, -1e308, 5e-324, 0.017, 1.0, 1.0000001, 0.0169999)


def height(rng: random.Random) -> float:
    """Return a height, allowed or not, a number or not."""
    kind = rng.random()
    return rng.uniform(0.0, 1.1) if kind < 0.7 else rng.choice(ODD) if kind < 0.9 else rng.uniform(-1e9, 1e9)


def stamp(rng: random.Random, now: int) -> int:
    """Return the next instant [ns]: soon, late, the same again, or anywhere, before too."""
    kind = rng.random()
    if kind < 0.8:
        return now + rng.randrange(200_000_000)
    if kind < 0.9:
        return now
    return rng.randrange(2**31) * 10**9 if kind < 0.92 else max(0, now - rng.randrange(10**10))


@dataclass
class Judge:
    """What has to hold between two readings of a ceiling."""

    beyond: float = 0.0  # the highest height [m]
    step: float = 0.0  # in which the ceiling is computed [s]
    last: float = math.nan
    at: int = 0  # [ns]
    count: int = 0

    def take(self, height: float, target: float, now: int, begun: int | None = None) -> None:
        """Judge a reading at `now`, or begun before; the clock that says so may have been set."""
        assert math.isnan(target) or LIMITS.lowest <= target <= LIMITS.highest
        assert math.isnan(height) or LIMITS.lowest <= height <= LIMITS.highest + self.beyond + ROUNDING
        passed = max(0, now - self.at) * 1e-9
        if math.isfinite(self.last) and math.isfinite(height):
            assert abs(height - self.last) <= LIMITS.speed * (passed + self.step) + ROUNDING
        self.last, self.at = height, now if begun is None else begun
        self.count += 1


def storm(ceiling: CeilingActuator, rng: random.Random, requests: int, judge: Callable[[int], None]) -> None:
    """Make random requests of every kind; `judge` is called after each, with its instant [ns]."""
    now, refusals = 0, list[str]()
    ceiling.connect(now)
    ceiling.activate(now)
    for number in range(requests):
        now = stamp(rng, now)
        kind = rng.random()
        try:
            if kind < 0.9:
                ceiling.move(height(rng), rng.randrange(2**32) if kind < 0.3 else number, now)
            elif kind < 0.95:
                ceiling.activate(now)
            elif kind < 0.98:
                ceiling.deactivate(now)
            else:
                ceiling.connect(now)
        except DriverError as error:
            refusals.append(str(error))
        judge(now)
    assert not any("\n" in text for text in refusals)


def test_the_simulated_ceiling_keeps_its_limits() -> None:
    ceiling, judge = SimulatedActuator(LIMITS, 0.3), Judge()

    def look(now: int) -> None:
        reading = ceiling.read(now)
        judge.take(reading.height, reading.target, now)
        assert abs(reading.velocity) in (0.0, LIMITS.speed)

    storm(ceiling, random.Random(1), REQUESTS, look)
    assert judge.count == REQUESTS


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("part", CEILING)
def test_a_simulated_ceiling_that_fails_keeps_them_too(part: str, kind: str) -> None:
    """Its true height, to the limit switch; what its sensor reads is another thing."""
    ceiling = FaultyActuator(LIMITS, 0.3, [Injected(part, kind, 1.0, 1e6)])
    judge = Judge(TO_THE_SWITCH, step=1e-3)

    def look(now: int) -> None:
        reading = ceiling.read(now)
        judge.take(ceiling.true_height, reading.target if reading.mode is Mode.MOVING else math.nan, now)

    storm(ceiling, random.Random(2), REQUESTS // 250, look)
    assert judge.count == REQUESTS // 250


@pytest.fixture
def context() -> Iterator[Context]:
    made = Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_motor_node_keeps_them_as_well(context: Context, lockstep: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages go into the node's own callback, in place of the middleware's hands; its states are judged."""
    values = {"backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.3, "initial_height": 0.3}
    given = values | {"lockstep": lockstep, "autostart": False}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    motor = MotorNode(parameter_overrides=overrides, context=context, enable_rosout=False)
    motor.trigger_configure()
    motor.trigger_activate()
    (commands,) = (one for one in motor.subscriptions if one.topic_name == "/ceiling/command")
    (states,) = (one for one in motor.publishers if one.topic_name == "/ceiling/state")
    period = round(1e9 / motor.get_parameter("rate").value)
    timers = [timer for timer in motor.timers if timer.timer_period_ns == period]
    assert len(timers) == (not lockstep)
    published: list[CeilingState] = []
    monkeypatch.setattr(states, "publish", published.append)
    judge, rng, now = Judge(), random.Random(3), 0
    for number in range(REQUESTS // 5):
        now = stamp(rng, now)
        seconds, rest = divmod(min(now, 2**31 * 10**9 - 1), 10**9)
        odd = rng.random() < 0.05
        at = Time(sec=-seconds if odd else seconds, nanosec=rest)
        command = CeilingCommand(
            header=Header(stamp=at, frame_id="selector_node"), handshake=rng.random() < 0.02,
            sequence=rng.randrange(2**32), height=height(rng), excitation_amplitude=height(rng),
            predicted_amplitude=height(rng), method="lookup", reason="a storm",
        )  # fmt: skip
        begun = time.monotonic_ns()
        commands.callback(command, {"received_timestamp": 0 if odd else rng.randrange(2**62)})
        if number % 10 == 9:
            for timer in timers:
                timer.callback()
        for state in published:
            assert abs(state.velocity) <= LIMITS.speed
            assert LIMITS.lowest <= state.height <= LIMITS.highest
            if not lockstep:
                judge.take(state.height, state.target, time.monotonic_ns(), begun)
            elif not command.handshake:  # which moves no clock
                judge.take(state.height, state.target, at.sec * 10**9 + at.nanosec)
        published.clear()
    assert judge.count > REQUESTS // 60
    motor.destroy_node()
