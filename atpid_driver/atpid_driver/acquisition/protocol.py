# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every acquisition device has: its errors, its settings, and the protocol that it implements.

Settings are checked before any device is opened. The acquisition nodes declare a ROS parameter for each setting of a
backend: `setting` gives it description and unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import Document
from atpid_common.parameters import problem_of, setting
from atpid_driver import DriverError


class AcquisitionError(DriverError):
    """A device could not be opened, set up or read."""

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code  # the vendor's error code, None where the driver itself detected the fault


class LibraryMissingError(AcquisitionError):
    """The vendor's library is not installed."""


class DeviceMissingError(AcquisitionError):
    """No device was found where one is expected."""


class WrongDeviceError(AcquisitionError):
    """A device was found, but not the one asked for."""


class StreamLostError(AcquisitionError):
    """A running stream ended by itself: unplugged, overrun, stalled."""


class NotStreamingError(AcquisitionError):
    """A block was asked for while no stream is running."""

    retry = False


class SetupRefusedError(AcquisitionError):
    """The device cannot do what was asked: rate, channel, range."""

    retry = False


_T7_RANGES = (10.0, 1.0, 0.1, 0.01)

S = TypeVar("S", bound="AcquisitionSettings")


@dataclass(frozen=True)
class Channel:
    """One input: its name in the messages and where it is wired."""

    name: str
    terminal: str
    kind: str = "voltage"

    def __post_init__(self) -> None:
        """Raise SetupRefusedError for what is no channel."""
        if self.kind not in ("voltage", "iepe"):
            raise SetupRefusedError(f"kind of channel {self.name}: given {self.kind!r}; allowed: 'voltage', 'iepe'")
        if not all(isinstance(text, str) and text for text in (self.name, self.terminal)):
            raise SetupRefusedError(f"channel {self.name!r} at terminal {self.terminal!r}: give both a name")


@dataclass(frozen=True, kw_only=True)
class AcquisitionSettings:
    """What all backends need: which device, which channels, how fast, scans a block."""

    channels: tuple[Channel, ...]
    scans_per_block: int
    serial: int = setting(0, "serial number the device must have; 0: take any", "", 0, 2**32 - 1)
    rate: float = setting(float, "scan rate asked for; the blocks carry that of the device", "Hz", 0.1, 100_000.0)
    library: str = setting("", "path of the vendor's library; empty: where the loader finds it")

    def __post_init__(self) -> None:
        """Raise SetupRefusedError: one line with what was given and what is allowed."""
        if problem := problem_of(self):
            raise SetupRefusedError(problem)
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names) or not names:
            raise SetupRefusedError(f"channels: given {', '.join(names) or 'none'}; allowed: one or more, each once")
        if self.scans_per_block < 1:
            raise SetupRefusedError(f"scans_per_block: given {self.scans_per_block}; allowed: at least 1")


@dataclass(frozen=True, kw_only=True)
class SimulatedSettings(AcquisitionSettings):
    """Sines of one amplitude, offset and frequency, paced like a device."""

    amplitude: float = setting(1.0, "of the simulated backend's sines", "V", 0.0, 100.0)
    offset: float = setting(3.0, "of the simulated backend's sines", "V", -100.0, 100.0)
    frequency: float = setting(5.0, "of the simulated backend's sines", "Hz", 1e-3, 50_000.0)


@dataclass(frozen=True, kw_only=True)
class LabJackSettings(AcquisitionSettings):
    """A T7 over LJM; `library` is a path to libLabJackM.so where the loader does not find it by name."""

    connection: str = setting("ANY", "how the T7 is connected", choices=("ANY", "USB", "TCP", "ETHERNET", "WIFI"))
    voltage_range: float = setting(10.0, "input range: 10, 1, 0.1 or 0.01", "V", 0.01, 10.0)
    resolution_index: int = setting(0, "a larger one is quieter and slower; 0: the device chooses", "", 0, 8)
    settling_us: float = setting(0.0, "settling time between channels; 0: the device chooses", "us", 0.0, 4400.0)
    converter_noise: float = setting(
        6e-4, "readings of a constant voltage spread no further; a sensor that spreads no more is frozen", "V", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        """Raise SetupRefusedError for a range that a T7 does not have, too."""
        super().__post_init__()
        if self.voltage_range not in _T7_RANGES:
            ranges = ", ".join(f"{one:g}" for one in _T7_RANGES)
            raise SetupRefusedError(f"voltage_range: given {self.voltage_range:g} V; allowed: a T7's {ranges} V")


@dataclass(frozen=True, kw_only=True)
class NiSettings(AcquisitionSettings):
    """An NI-9230 through NI-DAQmx here, or on another PC through NI's gRPC device server at `grpc` ("host:port")."""

    device: str = setting("cDAQ1Mod1", "the module's name in NI MAX")
    voltage_range: float = setting(30.0, "input range", "V", 0.001, 100.0)
    excitation_current: float = setting(0.004, "current of IEPE inputs", "A", 0.0, 0.02)
    grpc: str = setting("", "host:port of NI's gRPC device server on another PC; empty: the driver on this one")

    def __post_init__(self) -> None:
        """Raise SetupRefusedError for a module without a name, too."""
        super().__post_init__()
        if not self.device:
            raise SetupRefusedError("device: given nothing; allowed: the module's name in NI MAX")


def wired(values: Document) -> Document:
    """Return `channels` and `scans_per_block` as a backend takes them, of the parameters of an acquisition node.

    Raises SetupRefusedError.
    """
    names, terminals, kinds = (list(values.get(key, ["voltage"])) for key in ("channels", "terminals", "kinds"))
    kinds *= len(names) if len(kinds) == 1 else 1
    if not len(names) == len(terminals) == len(kinds):
        raise SetupRefusedError(
            f"{len(names)} channels, {len(terminals)} terminals, {len(kinds)} kinds: give one of each for a channel"
        )
    channels = tuple(map(Channel, names, terminals, kinds))
    return {"channels": channels, "scans_per_block": max(1, round(values["rate"] / values["blocks_per_second"]))}


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


class Device(Generic[S]):
    """What the built-in backends share: names of channels that are sampled at once, the serial number, the indices.

    `_take` of the subclass waits for the next scans (n_scans, n_channels) [V] and returns them with the backlog.
    """

    _take: Callable[[], tuple[Volts, int]]
    close: Callable[[], None]
    _rate: float | None = None  # of the stream [Hz]; None: there is none
    _next = _dropped = 0  # index of the next scan; scans lost in this stream

    def __init__(self, settings: S) -> None:
        self._settings = settings

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
