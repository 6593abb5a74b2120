# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The clock of a device on the host's: random delays and drifts, stretches in which all is late, a wall clock set."""

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_driver.clock import TIME_BASE, DeviceClock, time_base_ns

STEP = 0.05


def followed(seed: int, drift: float, seconds: float, late: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return error of the stamps, their stated deviation and the drift's error [s, s, ppm] second by second (k, 3).

    Delays: exponential ones of a random mean up to a millisecond, one block in fifty some milliseconds more with a
    heavy tail; from late[0] to late[1] all are late[2] later [s].
    """
    random, clock, found = np.random.default_rng(seed), DeviceClock(), []
    mean = random.uniform(5e-5, 1e-3)
    for block in range(1, round(seconds / STEP)):
        at = block * STEP
        true = 1000.0 + at * (1.0 + drift)
        delay = random.exponential(mean) + (random.random() < 0.02) * 1e-3 * random.pareto(1.5)
        clock.add(at, true + delay + (late[2] if late[0] < at < late[1] else 0.0))
        if block % 20 == 0:
            found.append((clock.steady(at) - true, clock.error(at), clock.drift_ppm - 1e6 * drift))
    return np.array(found)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(-80e-6, 80e-6), st.floats(1e-4, 1.0))
def test_any_clock_is_followed_within_the_stated_error(seed: int, drift: float, late: float) -> None:
    """A third of two minutes late by up to a second does not show; two minutes give the drift to 1 ppm."""
    found = followed(seed, drift, 200.0, (130.0, 170.0, late))
    settled = found[20:]
    assert np.mean(np.abs(settled[:, 0]) < 2.0 * settled[:, 1]) > 0.95
    assert np.abs(found[119:, 2]).max() < 1.0


def test_an_hour_gives_the_drift_of_two_devices_to_a_ten_millionth() -> None:
    one, other = (followed(seed, drift, 3600.0, (1000.0, 1050.0, 5e-3)) for seed, drift in ((1, 10e-6), (2, -10e-6)))
    assert abs(one[-1, 2] - other[-1, 2]) < 0.1
    assert np.abs(one[-60:, 0] - other[-60:, 0]).max() < 2.8e-6, "0.1 degrees at 100 Hz"


def test_what_is_kept_does_not_grow() -> None:
    clock = DeviceClock()
    for block in range(20 * 1000):
        clock.add(block * STEP, 5.0 + block * STEP)
    assert len(clock._least) == 120
    assert clock.drift_ppm == pytest.approx(0.0, abs=1e-6)


def test_nothing_is_stated_before_it_is_known() -> None:
    clock = DeviceClock()
    assert math.isnan(clock.steady(0.0))
    clock.add(0.05, 3.0)
    assert clock.steady(0.05) == 3.0
    assert math.isnan(clock.drift_ppm)
    assert math.isnan(clock.offset_s)
    assert math.isnan(clock.error(0.05))


def test_time_zero_is_before_the_start_returned() -> None:
    clock = DeviceClock(began=7.0)
    clock.add(1.0, 8.3)
    assert clock.steady(0.0) == 7.0
    assert clock.device(8.0) == pytest.approx(1.0)


def test_a_wall_clock_that_is_set_moves_no_stamp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TIME_BASE, str(time.time_ns() - time.monotonic_ns()))
    base, clock, now = time_base_ns(), DeviceClock(), time.time_ns()
    clock.add(0.0, 50.0)
    before = clock.stamp_ns(0.0)
    monkeypatch.setattr(time, "time_ns", lambda: now + 3600 * 10**9)
    clock.add(1.0, 51.0)
    assert clock.stamp_ns(1.0) - before == 10**9
    assert time_base_ns() == base
    assert time_base_ns(anew=True) == pytest.approx(base + 3600 * 10**9, abs=10**10)
    assert time_base_ns() == time_base_ns()
