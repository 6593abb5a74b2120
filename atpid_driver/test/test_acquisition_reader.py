# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reader: order, bounded queue, recovery with true indices, one line a fault; and the clock of a device."""

import math
import pickle
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from acquisition_rigs import channels
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_common.testing import PATIENCE
from atpid_driver.acquisition import Block, DeviceIdentity, SetupRefusedError, StreamLostError
from atpid_driver.acquisition.protocol import SimulatedSettings
from atpid_driver.acquisition.reader import Backoff, Reader
from atpid_driver.acquisition.simulated import SimulatedAcquisition
from atpid_driver.clock import TIME_BASE, DeviceClock, time_base_ns

SETTINGS = SimulatedSettings(channels=channels(0, "x"), rate=10_000.0, scans_per_block=100)


class Watch:
    """Collects blocks and reports of a reader, waiting for them."""

    def __init__(self, device: SimulatedAcquisition, **options: Any) -> None:
        self._ready = threading.Event()
        self._reports: queue.Queue[tuple[bool, str]] = queue.Queue()
        options = {"backoff": Backoff(first=0.01, longest=0.02), **options}
        self.reader = Reader(device, device.open(), self._ready.set, lambda *one: self._reports.put(one), **options)
        self.reader.start()

    def blocks(self, count: int) -> list[Block]:
        taken: list[Block] = []
        while len(taken) < count:
            assert self._ready.wait(PATIENCE)
            self._ready.clear()
            taken += self.reader.take()
        return taken

    def fault(self) -> str:
        fault, text = self._reports.get(timeout=PATIENCE)
        assert fault
        return text.removeprefix("simulated:1: ")

    def recovers(self) -> None:
        assert not self._reports.get(timeout=PATIENCE)[0]

    def has_no_more(self) -> bool:
        return self._reports.empty()


Watching = Callable[..., Watch]


@pytest.fixture
def watch() -> Iterator[Watching]:
    made: list[Watch] = []

    def watching(device: SimulatedAcquisition | None = None, **options: Any) -> Watch:
        made.append(Watch(device or SimulatedAcquisition(SETTINGS), **options))
        return made[-1]

    yield watching
    for one in made:
        one.reader.stop()


def complete(blocks: list[Block]) -> bool:
    return [block.first_index for block in blocks] == [100 * k for k in range(len(blocks))]


def test_a_slow_taker_holds_the_device_back_but_loses_nothing_and_order_is_kept(watch: Watching) -> None:
    slow, full = watch(depth=3), watch(depth=1)
    pause = threading.Event()
    while slow.reader.status.queued < 3 or full.reader.status.queued < 1:
        assert not pause.wait(0.001)
    assert slow.reader.status.queued == 3
    assert complete(slow.blocks(20))
    slow.reader.stop()
    assert not slow.reader.status.streaming
    assert slow.reader.status.dropped == 0
    full.reader.stop()  # ends all the same
    assert full.reader.status.last_error == ""


def test_unplugged_and_back_the_indices_go_on_with_the_clock(watch: Watching, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone() -> None:
        raise StreamLostError("unplugged")

    device = SimulatedAcquisition(SETTINGS)
    one = watch(device)
    blocks = one.blocks(3)
    for name in ("open", "_take"):
        monkeypatch.setattr(device, name, gone)
    assert one.fault() != one.fault()
    monkeypatch.undo()
    one.recovers()
    blocks += one.blocks(3)
    status = one.reader.status
    expected = 0
    for block in blocks:
        assert block.first_index >= expected
        expected = block.next_index
    assert status.dropped == blocks[-1].dropped > 0
    assert sum(len(block.volts) for block in blocks) + blocks[-1].dropped == expected
    assert (status.interruptions, status.last_error) == (1, "")
    assert one.has_no_more()  # each line once, however often it was tried
    # another device in the same place is not taken
    for name in ("open", "_take"):
        monkeypatch.setattr(device, name, gone)
    one.fault()
    one.fault()
    monkeypatch.setattr(device, "open", lambda: DeviceIdentity("simulated", 77))
    assert {"simulated:77", "simulated:1:"} <= set(one.fault().split())
    monkeypatch.undo()
    one.recovers()


def test_a_refused_set_up_is_reported_and_not_tried_again(watch: Watching) -> None:
    class Refusing(SimulatedAcquisition):
        def start(self) -> float:
            raise SetupRefusedError("wrong")

    one = watch(Refusing(SETTINGS))
    assert one.fault() == "wrong"
    one.reader.stop()
    assert one.has_no_more()


def test_a_set_up_that_has_streamed_is_tried_again_with_growing_waits(watch: Watching) -> None:
    starts: list[float] = []

    class Overlapping(SimulatedAcquisition):
        """As a T7 whose scans overlap now and then (LJM 2942): one block, then the stream ends."""

        blocks = 0

        def start(self) -> float:
            starts.append(time.monotonic())
            return super().start()

        def read(self) -> Block:
            self.blocks += 1
            if self.blocks % 2 == 0 and self.blocks < 11:
                self.stop()
                raise SetupRefusedError("a scan takes longer than the scan period")
            return super().read()

    one = watch(Overlapping(SETTINGS), backoff=Backoff(first=0.02, longest=0.3))
    blocks = one.blocks(8)
    status = one.reader.status
    assert (status.interruptions, status.last_error) == (5, "")
    assert sum(len(block.volts) for block in blocks) + blocks[-1].dropped == blocks[-1].next_index
    assert (np.diff(starts) >= [0.02, 0.04, 0.08, 0.16, 0.3]).all()


def test_a_bug_in_a_backend_is_reported(watch: Watching) -> None:
    class Broken(SimulatedAcquisition):
        def read(self) -> Block:
            raise ZeroDivisionError("oops")

    assert "oops" in watch(Broken(SETTINGS)).fault()


def test_backoff_doubles_to_its_longest_and_an_identity_is_a_word() -> None:
    assert [Backoff(0.5, 3.0).delay(attempt) for attempt in range(5)] == [0.5, 1.0, 2.0, 3.0, 3.0]
    assert str(DeviceIdentity("labjack", 470012345)) == "labjack:470012345"


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
    clock, sizes = DeviceClock(), []
    for block in range(20 * 1000):
        clock.add(block * STEP, 5.0 + block * STEP)
        sizes.append(len(pickle.dumps(clock)) if block % 5000 == 4999 else 0)
    assert max(sizes) < 1.02 * sizes[4999] < 10_000
    assert clock.drift_ppm == pytest.approx(0.0, abs=1e-6)


def test_nothing_is_stated_before_it_is_known() -> None:
    clock = DeviceClock()
    assert math.isnan(clock.steady(0.0))
    clock.add(0.05, 3.0)
    assert clock.steady(0.05) == 3.0
    assert np.isnan([clock.drift_ppm, clock.offset_s, clock.error(0.05)]).all()
    clock = DeviceClock(began=7.0)  # time 0 is before the start returned
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
