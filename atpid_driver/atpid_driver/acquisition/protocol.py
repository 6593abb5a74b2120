# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The protocol that every acquisition device implements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from atpid_driver.acquisition.errors import AcquisitionError, NotStreamingError, WrongDeviceError
from atpid_driver.acquisition.settings import AcquisitionSettings

Volts = NDArray[np.float64]


@dataclass(frozen=True)
class DeviceIdentity:
    """Model and serial number, as the device reports them."""

    model: str
    serial: int

    def __str__(self) -> str:
        return f"{self.model}:{self.serial}"


@dataclass(frozen=True)
class Block:
    """Scans read at once.

    `volts` is (n_scans, n_channels) [V], NaN where the device lost the scan; `first_index` counts scans from the
    start of the stream; `dropped` are the scans lost since then; `backlog` the scans that wait in the device and
    in its driver after this read. `stamp_ns` is the Reader's: when the first was taken.
    """

    first_index: int
    volts: Volts
    dropped: int
    backlog: int
    stamp_ns: int = 0

    @property
    def next_index(self) -> int:
        """Index of the scan after the last one of this block."""
        return self.first_index + len(self.volts)


class Acquisition(Protocol):
    """A device that streams blocks of voltages. All calls come from one thread; any may raise AcquisitionError.

    Who adds one implements these methods and names a `registry.Backend` in the entry-point group `atpid.acquisition`;
    `contract.AcquisitionContract` has the tests that every backend passes (docs/extend.md).

    One with a clock of its own has the attribute `start_ns`: its time of index 0 [ns since the epoch].
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order of the columns."""

    def open(self) -> DeviceIdentity:
        """Connect, check that it is the device asked for, and return its identity."""

    def start(self) -> float:
        """Start the stream, the next scan having index 0; return the actual scan rate [Hz]."""

    def skew(self) -> tuple[float, ...]:
        """Delay of each channel's sampling instant after the scan's own, at the actual rate [s]."""

    def read(self) -> Block:
        """Wait for the next block and return it; StreamLostError if none can come."""

    def stop(self) -> None:
        """Stop the stream; no error if none is running or the device is gone."""

    def close(self) -> None:
        """Release the device; no error if it is not open or already gone."""


class Device:
    """What the built-in backends share: names of channels that are sampled at once, the serial number, the indices.

    `_take` of the subclass waits for the next scans (n_scans, n_channels) [V] and returns them with the backlog.
    """

    _settings: AcquisitionSettings
    _take: Callable[[], tuple[Volts, int]]
    close: Callable[[], None]
    _rate: float | None = None  # of the stream [Hz]; None: there is none
    _next = _dropped = 0  # index of the next scan; scans lost in this stream

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(channel.name for channel in self._settings.channels)

    def skew(self) -> tuple[float, ...]:
        """Return zeros: each channel has a converter of its own, and all sample at once."""
        return (0.0,) * len(self._settings.channels)

    def read(self) -> Block:
        """Wait for the next block and return it; an error ends the stream."""
        if self._rate is None:
            raise NotStreamingError("no block can be read: start the stream first")
        try:
            volts, backlog = self._take()
        except AcquisitionError:
            self._rate = None
            raise
        first, self._next = self._next, self._next + len(volts)
        return Block(first, volts, self._dropped, backlog)

    def _started(self, rate: float) -> float:
        """Note that a stream has begun at `rate` [Hz], which is returned."""
        self._rate, self._next, self._dropped = rate, 0, 0
        return rate

    def _check_serial(self, found: str, serial: int) -> None:
        """Close and raise WrongDeviceError where `serial`, that of the device `found`, is not the one asked for."""
        if self._settings.serial not in (0, serial):
            self.close()
            raise WrongDeviceError(f"{found} serial number {serial}, expected {self._settings.serial}: set `serial`")
