# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The reader: order, bounded queue, recovery with true indices, one line a fault; and the clock it measures."""

import queue
import threading
import time
from typing import Any, ClassVar

import numpy as np
from acquisition_rigs import channels

from atpid_driver.acquisition import Block, DeviceIdentity, SetupRefusedError
from atpid_driver.acquisition.reader import Backoff, Reader
from atpid_driver.acquisition.settings import SimulatedSettings
from atpid_driver.acquisition.simulated import Faults, SimulatedAcquisition

TIMEOUT = 100.0
QUICK = Backoff(first=0.01, longest=0.02)


class Watch:
    """Collects blocks and reports of a reader, waiting for them."""

    def __init__(self, device: SimulatedAcquisition, **options: Any) -> None:
        self._ready = threading.Event()
        self.reports: queue.Queue[tuple[bool, str]] = queue.Queue()
        identity = device.open()
        self.reader = Reader(
            device,
            identity,
            self._ready.set,
            lambda *report: self.reports.put(report),
            **{"backoff": QUICK, **options},
        )
        self.reader.start()

    def blocks(self, count: int) -> list[Block]:
        taken: list[Block] = []
        while len(taken) < count:
            assert self._ready.wait(TIMEOUT)
            self._ready.clear()
            taken += self.reader.take()
        return taken

    def report(self) -> tuple[bool, str]:
        return self.reports.get(timeout=TIMEOUT)


def simulated(faults: Faults | None = None, rate: float = 10_000.0, scans: int = 100) -> SimulatedAcquisition:
    settings = SimulatedSettings(channels=channels(0, "x"), rate=rate, scans_per_block=scans)
    return SimulatedAcquisition(settings, faults)


def test_blocks_come_in_order_and_complete() -> None:
    watch = Watch(simulated())
    blocks = watch.blocks(20)
    watch.reader.stop()
    starts = [block.first_index for block in blocks]
    assert starts == [100 * k for k in range(len(blocks))]
    assert not watch.reader.status.streaming
    assert watch.reader.status.dropped == 0


def test_a_slow_taker_holds_the_device_back_but_loses_nothing() -> None:
    watch = Watch(simulated(), depth=3)
    deadline = threading.Event()
    while watch.reader.status.queued < 3:
        assert not deadline.wait(0.001)
    assert watch.reader.status.queued == 3
    blocks = watch.blocks(10)
    watch.reader.stop()
    assert [block.first_index for block in blocks] == [100 * k for k in range(len(blocks))]


def test_stop_while_the_queue_is_full_ends() -> None:
    watch = Watch(simulated(), depth=1)
    while watch.reader.status.queued < 1:
        assert watch.reader.status.last_error == ""
    watch.reader.stop()


def test_unplugged_and_replugged_the_indices_go_on_with_the_clock() -> None:
    faults = Faults()
    watch = Watch(simulated(faults))
    before = watch.blocks(3)
    faults.plugged = False
    assert watch.report() == (True, "simulated:1: simulated device was unplugged")
    fault, text = watch.report()
    assert fault
    assert text == "simulated:1: simulated device not found: plug it in; trying again"
    faults.plugged = True
    fault, text = watch.report()
    assert not fault
    assert "streaming again" in text
    blocks = before + watch.blocks(3)
    status = watch.reader.status
    watch.reader.stop()
    expected = 0
    for block in blocks:
        jump = block.first_index - expected
        assert jump >= 0
        expected = block.next_index
    assert status.dropped == blocks[-1].dropped > 0
    assert sum(len(block.volts) for block in blocks) + blocks[-1].dropped == expected
    assert status.interruptions == 1
    assert status.last_error == ""
    assert watch.reports.empty()  # each line once, however often it was tried


def test_another_device_in_the_same_place_is_not_taken() -> None:
    faults = Faults()
    watch = Watch(simulated(faults))
    watch.blocks(1)
    faults.plugged, faults.serial = False, 77
    watch.report()
    watch.report()
    faults.plugged = True
    assert "expected simulated:1" in watch.report()[1]
    faults.serial = 1
    assert "streaming again" in watch.report()[1]
    watch.reader.stop()


def test_a_refused_set_up_is_reported_and_not_tried_again() -> None:
    class Refusing(SimulatedAcquisition):
        def start(self) -> float:
            raise SetupRefusedError("rate too high")

    watch = Watch(Refusing(SimulatedSettings(channels=channels(0, "x"), rate=1.0, scans_per_block=1)))
    assert watch.report() == (True, "simulated:1: rate too high")
    watch.reader.stop()
    assert watch.reports.empty()


def test_a_set_up_that_has_streamed_is_tried_again_with_growing_waits() -> None:
    class Overlapping(SimulatedAcquisition):
        """As a T7 whose scans overlap now and then (LJM 2942): one block, then the stream ends."""

        starts: ClassVar[list[float]] = []
        blocks = 0

        def start(self) -> float:
            self.starts.append(time.monotonic())
            return super().start()

        def read(self) -> Block:
            self.blocks += 1
            if self.blocks % 2 == 0 and self.blocks < 11:
                self.stop()
                raise SetupRefusedError("a scan takes longer than the scan period")
            return super().read()

    settings = SimulatedSettings(channels=channels(0, "x"), rate=10_000.0, scans_per_block=100)
    watch = Watch(Overlapping(settings), backoff=Backoff(first=0.02, longest=0.3))
    blocks = watch.blocks(8)
    status = watch.reader.status
    watch.reader.stop()
    assert (status.interruptions, status.last_error) == (5, "")
    assert sum(len(block.volts) for block in blocks) + blocks[-1].dropped == blocks[-1].next_index
    waits = np.diff(Overlapping.starts)
    assert (waits >= [0.02, 0.04, 0.08, 0.16, 0.3]).all()


def test_a_bug_in_a_backend_is_reported() -> None:
    class Broken(SimulatedAcquisition):
        def read(self) -> Block:
            raise ZeroDivisionError("oops")

    watch = Watch(Broken(SimulatedSettings(channels=channels(0, "x"), rate=1.0, scans_per_block=1)))
    assert "internal error" in watch.report()[1]
    watch.reader.stop()


def test_backoff_doubles_to_its_longest() -> None:
    assert [Backoff(0.5, 3.0).delay(attempt) for attempt in range(5)] == [0.5, 1.0, 2.0, 3.0, 3.0]


def test_identity_in_words() -> None:
    assert str(DeviceIdentity("labjack", 470012345)) == "labjack:470012345"
