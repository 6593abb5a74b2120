# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads a device in a thread of its own, queues its blocks, and reconnects after a fault.

A set-up that the device refuses at first waits for a person. Once it has streamed, whatever ends the stream is an
interruption: the same set-up has worked, so it is tried again, also where the error is that of a set-up (LJM 2942).
Time and index go on through an interruption: a stream that comes back is given the index its first scan would have had
in the stream before, by the clocks of both, so that the gap shows in the indices and is counted as dropped.
Each block gets the stamp of its first scan, by the device's clock as it is followed on the host's steady one.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from atpid_driver.acquisition.protocol import (
    Acquisition,
    AcquisitionError,
    Block,
    DeviceIdentity,
    StreamLostError,
    WrongDeviceError,
)
from atpid_driver.clock import DeviceClock

log = logging.getLogger("atpid_driver.acquisition")
_RATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Backoff:
    """Waiting times between attempts: `first` seconds, then twice as long each time, at most `longest`."""

    first: float = 0.5
    longest: float = 10.0

    def delay(self, attempt: int) -> float:
        """Return how long to wait after failed attempt number 0, 1, 2, ... [s]."""
        return min(self.longest, self.first * 2.0 ** min(attempt, 30))


@dataclass(frozen=True)
class Status:
    """A snapshot of the state of the stream, for diagnostics."""

    streaming: bool = False
    rate: float = float("nan")  # actual scan rate [Hz]
    next_index: int = 0
    dropped: int = 0
    backlog: int = 0
    queued: int = 0  # blocks read and not yet taken
    interruptions: int = 0
    last_error: str = ""
    offset_s: float = float("nan")
    drift_ppm: float = float("nan")
    error_s: float = float("nan")  # standard deviation of the stamps, but for the least delay [s]


class Reader:
    """Reads an opened device until it is stopped; `ready` is called from the thread whenever there is something new.

    `report` is called with each distinct line to be logged: (is_fault, text).
    """

    def __init__(
        self,
        device: Acquisition,
        identity: DeviceIdentity,
        ready: Callable[[], None],
        report: Callable[[bool, str], None],
        depth: int = 64,
        backoff: Backoff | None = None,
    ) -> None:
        self._device, self._identity = device, identity
        self._ready, self._report = ready, report
        self._depth, self._backoff = depth, backoff or Backoff()
        self._queue: deque[Block] = deque()
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._status = Status()
        self._base_index = self._base_dropped = self._attempts = 0
        self._started = 0.0  # steady clock when the stream was last started [s]
        self._clock, self._placed = DeviceClock(), (DeviceClock(), 0)  # of this stream; of the last, its first index
        self._stated_first: int | None = None  # what that one stated [ns]
        self.rate: float | None = None  # as the device states it [Hz]; None until the first block
        self._thread = threading.Thread(target=self._run, name=f"acquisition {identity}", daemon=True)

    def start(self) -> None:
        """Begin to stream."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the stream and wait for the thread; the device stays open."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread.ident is not None:
            self._thread.join()

    def take(self) -> list[Block]:
        """Return the blocks read since the last call, oldest first."""
        with self._changed:
            blocks = list(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        return blocks

    @property
    def status(self) -> Status:
        """State of the stream now."""
        with self._changed:
            clock, status = self._clock, replace(self._status, queued=len(self._queue))
            error = clock.error((status.next_index - self._base_index) / status.rate)
            return replace(status, offset_s=clock.offset_s, drift_ppm=clock.drift_ppm, error_s=error)

    def _run(self) -> None:
        try:
            self._read_until_stopped()
        except Exception as error:  # an exception would end the thread without a report
            log.exception("acquisition thread")
            self._fault(f"internal error, streaming ended: {error!r}")
        finally:
            self._update(streaming=False)
            self._ignoring_errors(self._device.stop)

    def _read_until_stopped(self) -> None:
        while not self._stop.is_set():
            try:
                self._begin()
                while not self._stop.is_set():
                    self._enqueue(self._device.read())
            except AcquisitionError as error:
                self._fault(f"{self._identity}: {error}")
                if not error.retry and self.rate is None:
                    return
                self._recover()

    def _begin(self) -> None:
        """Start the stream; where its index 0 lies on the clock shows with its first block."""
        rate = self._device.start()
        self._started = time.monotonic()
        if self.rate is not None and abs(rate / self.rate - 1.0) > _RATE_TOLERANCE:
            raise StreamLostError(f"the stream came back at {rate:g} Hz, it ran at {self.rate:g} Hz")
        self._clock = DeviceClock(self._started)
        self._update(rate=rate)

    def _stated(self) -> int | None:
        """Return the time of index 0 that a device with a clock of its own states [ns since the epoch]; None: none."""
        stated: int | None = getattr(self._device, "start_ns", None)
        return stated

    def _place(self) -> None:
        """Give index 0 of a stream that has just begun its place after the streams before it."""
        rate, before, (clock, first) = self._status.rate, self._status.next_index, self._placed
        stated, gone = self._stated(), 0.0
        if before:
            was = self._stated_first
            gone = clock.device(self._clock.steady(0.0)) if stated is None or was is None else (stated - was) * 1e-9
        self.rate, self._base_index = rate, max(before, first + round(gone * rate))
        self._placed, self._stated_first = (self._clock, self._base_index), stated
        self._base_dropped = self._status.dropped + self._base_index - before
        again = self._status.interruptions > 0
        self._update(streaming=True, last_error="")
        if again:
            self._report(False, f"{self._identity}: streaming again, {self._base_index - before} scans lost")

    def _enqueue(self, block: Block) -> None:
        arrival, rate = time.monotonic(), self._status.rate
        with self._changed:
            self._clock.add(block.next_index / rate, arrival)
            stated, first_s = self._stated(), block.first_index / rate
            stamp_ns = self._clock.stamp_ns(first_s) if stated is None else stated + round(first_s * 1e9)
        if not self._status.streaming:
            self._place()
        if arrival - self._started > self._backoff.longest:
            self._attempts = 0
        with self._changed:
            first_index, dropped = block.first_index + self._base_index, block.dropped + self._base_dropped
            block = replace(block, first_index=first_index, dropped=dropped, stamp_ns=stamp_ns)
            # A full queue makes the device's own, larger buffer wait; only when that overflows are scans lost.
            self._changed.wait_for(lambda: len(self._queue) < self._depth or self._stop.is_set())
            self._queue.append(block)
            self._status = replace(
                self._status, next_index=block.next_index, dropped=block.dropped, backlog=block.backlog
            )
        self._ready()

    def _recover(self) -> None:
        """Open the device again, waiting longer after each attempt; each different reason is reported once.

        The waits go on growing while the stream ends again before it has run for the longest of them.
        """
        while not self._stop.wait(self._backoff.delay(self._attempts)):
            self._attempts += 1
            self._ignoring_errors(self._device.stop)
            self._ignoring_errors(self._device.close)
            try:
                identity = self._device.open()
                if identity != self._identity:
                    raise WrongDeviceError(f"{identity} answers, expected {self._identity}: connect the same device")
            except AcquisitionError as error:
                self._report_once(f"{self._identity}: {error}; trying again")
            else:
                return

    def _fault(self, text: str) -> None:
        self._update(streaming=False, interruptions=self._status.interruptions + 1)
        self._report_once(text)

    def _report_once(self, text: str) -> None:
        if text != self._status.last_error:
            self._update(last_error=text)
            self._report(True, text)

    def _update(self, **changes: Any) -> None:
        with self._changed:
            self._status = replace(self._status, **changes)
        self._ready()

    @staticmethod
    def _ignoring_errors(call: Callable[[], None]) -> None:
        try:
            call()
        except AcquisitionError as error:
            log.debug("while releasing the device: %s", error)
