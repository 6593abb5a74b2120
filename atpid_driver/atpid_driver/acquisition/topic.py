# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The samples of another ROS driver, message by message as they arrive, as scans of a device.

A message is placed by its stamp, where it has one; else by the number its publisher's middleware gave it, and its time
is that of the earliest arrivals, since a message is late but never early. What a driver without stamps has never
published leaves no trace.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_common.parameters import setting
from atpid_driver.acquisition.protocol import (
    AcquisitionSettings,
    Device,
    DeviceIdentity,
    DeviceMissingError,
    SetupRefusedError,
    StreamLostError,
    Volts,
)
from atpid_driver.clock import earliest_line

#: Largest difference of the measured rate from the one asked for [-]; time over which it is measured [s], and messages.
_RATE_OFF, _MEASURED_S, _MEASURED = 0.02, 2.0, 20
#: How many such times at most: a busy machine delays what came in one by more.
_TIMES = 4
#: The same of a rate from single steps, which jitter.
_ABOUT = 0.4
#: By how much of its distance from the grid a stamp moves it; longest step of the stamps [s].
_FOLLOW, _LONGEST_STEP = 0.02, 10.0


@dataclass(frozen=True, kw_only=True)
class TopicSettings(AcquisitionSettings):
    """A topic of any type; a channel's terminal is a number in a message: `data[2]`, `linear_acceleration.z`."""

    source: str = setting("", "topic of the driver, of the backend topic")
    source_type: str = setting("std_msgs/msg/Float64MultiArray", "type of its messages")
    columns: int = setting(0, "numbers of a scan, where an array holds several scans; 0: it holds one", "", 0, 1000)
    hold: float = setting(0.2, "how long a message that is missing is waited for", "s", 0.0, 10.0)
    silence: float = setting(2.0, "a driver that publishes nothing for so long has stopped", "s", 0.05, 600.0)

    def __post_init__(self) -> None:
        """Raise SetupRefusedError where there is no topic, too."""
        super().__post_init__()
        if not self.source:
            raise SetupRefusedError("source: given nothing; give the topic of the driver, such as /imu/data")


class _Arrival(NamedTuple):
    """One message."""

    values: Volts  # its scans (k, channels)
    time_ns: int  # its stamp, or when it came, by the steady clock
    number: int | None  # None: it is placed by its stamp


class TopicAcquisition(Device[TopicSettings]):
    """A driver's topic; `arrived` is called for each message, from any thread, whether or not a stream runs."""

    def __init__(self, settings: TopicSettings) -> None:
        super().__init__(settings)
        self.settings = settings
        self._arrivals: deque[_Arrival] = deque(maxlen=100_000)
        self._changed = threading.Condition()
        self._count, self._open = 0, False
        self.late = 0  # scans that came twice, or after they were given up
        self.start_ns: int | None = None  # by the driver's stamps, at index 0 [ns since the epoch]; None: it has none
        self._measured: float | None = None  # rate of the first stream [Hz]

    def arrived(self, values: Volts, stamp_ns: int | None, number: int | None) -> None:
        """Take the scans (k, channels) of a message, its stamp [ns] and its number, where it has them."""
        with self._changed:
            if stamp_ns is None:
                one = _Arrival(values, time.monotonic_ns(), self._count if number is None else number)
            else:
                one = _Arrival(values, stamp_ns, None)
            self._count += 1
            self._arrivals.append(one)
            self._changed.notify_all()

    def open(self) -> DeviceIdentity:
        """Return the topic as identity: it has no serial number."""
        self._check_serial(f"topic {self._settings.source} has", 0)
        return DeviceIdentity(self._settings.source.strip("/"), 0)

    def start(self) -> float:
        """Measure the rate for two seconds; the next message has index 0."""
        with self._changed:
            self._arrivals.clear()
            self._open = True
        seen: list[_Arrival] = []
        for _ in range(_TIMES):
            began = time.monotonic()
            while len(seen) < _MEASURED or time.monotonic() < began + _MEASURED_S:
                seen.append(self._next_arrival())
            scans, first = len(seen[-1].values), seen[0]
            places, slope, offset = self._line(seen)
            rate = scans / slope if slope > 0.0 else 0.0
            if abs(rate / self._settings.rate - 1.0) < _RATE_OFF:
                break
            self._check_rate(rate, _ABOUT)  # no delay is so large
        self._check_rate(rate, _RATE_OFF)
        self._measured = rate if self._measured is None else self._measured
        self._scans, self._rows = scans, dict[int, Volts]()
        zero = int(places.max()) + 1  # the place of index 0, in messages after the first one seen
        self._zero = zero + (first.number or 0)
        at_ns = first.time_ns + round((offset + slope * zero) * 1e9)
        self._reference = 0, at_ns  # a message, counted from index 0 on, and its stamp
        self.start_ns = at_ns if first.number is None else None
        self._reached: float | None = None
        return self._started(self._measured)

    def _line(self, seen: list[_Arrival]) -> tuple[Volts, float, float]:
        """Return the places of messages (n,) after the first, and slope and offset of their times over these [s]."""
        scans, first = len(seen[-1].values), seen[0]
        times = np.array([one.time_ns - first.time_ns for one in seen]) * 1e-9
        if first.number is None:
            step = float(np.median(np.diff(np.sort(times))))  # of whatever rate: messages may be lost, or early
            self._check_rate(scans / step if step > 0.0 else 0.0, _ABOUT)
            places = np.rint(times * self._settings.rate / scans)
            return places, *np.polyfit(places, times, 1)
        places = np.array([one.number - first.number for one in seen if one.number is not None], np.float64)
        return places, *earliest_line(places, times)

    def _check_rate(self, rate: float, off: float) -> None:
        if not abs(rate / self._settings.rate - 1.0) < off:
            raise SetupRefusedError(
                f"{self._settings.source} gives {rate:.4g} scans/s, `rate` is {self._settings.rate:g}: set it within "
                f"{100 * _RATE_OFF:g} %"
            )

    def _next_arrival(self, until: float | None = None) -> _Arrival:
        """Wait for a message; raise StreamLostError where none comes. Raises TimeoutError at `until` [s, steady]."""
        limit = time.monotonic() + self._settings.silence
        with self._changed:
            while not self._arrivals and self._open:
                now = time.monotonic()
                if until is not None and now >= until:
                    raise TimeoutError
                if now >= limit:
                    raise DeviceMissingError(
                        f"no message of type {self._settings.source_type} on {self._settings.source} for "
                        f"{self._settings.silence:g} s: start its driver, or look at topic and type"
                    )
                self._changed.wait(min(limit, until or limit) - now)
            if not self._open:
                raise StreamLostError(f"the stream of {self._settings.source} was stopped")
            return self._arrivals.popleft()

    def _take(self) -> tuple[Volts, int]:
        """Wait until the next scans are there, or those missing are given up, which are NaN and counted."""
        size, channels = self._settings.scans_per_block, len(self._settings.channels)
        due = range(self._next, self._next + size)
        while not all(index in self._rows for index in due):
            until = None if self._reached is None else self._reached + self._settings.hold
            try:
                self._place(self._next_arrival(until), due[-1])
            except TimeoutError:
                break
        volts = np.full((size, channels), np.nan)
        for row, index in enumerate(due):
            if index in self._rows:
                volts[row] = self._rows.pop(index)
            else:
                self._dropped += 1
        beyond = max(self._rows, default=-1)
        self._reached = time.monotonic() if beyond >= due[-1] + size else None
        return volts, len(self._rows) + len(self._arrivals)

    def _place(self, one: _Arrival, last: int) -> None:
        """Put the scans of a message where they belong. Raises StreamLostError: its stamp, or its size, is another."""
        source = self._settings.source
        if len(one.values) != self._scans:
            raise StreamLostError(f"{source} gives {len(one.values)} scans a message, {self._scans} before")
        if (one.number is None) != (self.start_ns is not None):
            raise StreamLostError(f"{source} gives messages with and without stamps: fill in all of them, or none")
        if one.number is None:
            place, at_ns = self._reference
            period_ns = 1e9 * self._scans / (self._measured or 1.0)
            ahead_ns = one.time_ns - at_ns
            if abs(ahead_ns) > _LONGEST_STEP * 1e9:
                raise StreamLostError(f"the stamps of {source} jump by {ahead_ns * 1e-9:.3g} s")
            steps = round(ahead_ns / period_ns)
            place += steps
            if steps > 0:
                off_ns = ahead_ns - steps * period_ns
                self._reference = place, at_ns + round(steps * period_ns + _FOLLOW * off_ns)
        else:
            place = one.number - self._zero
        first = place * self._scans
        for index, row in enumerate(one.values, first):
            if index >= self._next and index not in self._rows:
                self._rows[index] = row
            else:
                self.late += index >= 0
        if self._reached is None and first + self._scans > last:
            self._reached = time.monotonic()

    def stop(self) -> None:
        """Stop: messages that come are not kept."""
        with self._changed:
            self._open, self._rate = False, None
            self._changed.notify_all()

    def close(self) -> None:
        """Stop; the subscription is the node's."""
        self.stop()
