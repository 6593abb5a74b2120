# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A LabJack T7 streaming analogue inputs, through LabJack's own `labjack-ljm` package.

Registers, error codes and limits: LabJack's T-series datasheet 3.2 "Stream Mode" and its appendix A-1, and LJM's
error code list. After an overrun LJM fills the scans it lost with -9999 V, which no input can measure.
"""

import contextlib
import ctypes
import importlib
import io
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from atpid_common.errors import extras
from atpid_driver.acquisition import protocol
from atpid_driver.acquisition.protocol import Device, DeviceIdentity, LabJackSettings, Volts

_DUMMY_VOLTS = -9999.0
_BUFFER_BYTES = 32768
STOPPED_ALREADY = frozenset({1225, 1303, 2620})  # not initialised, not running, not enabled: it is stopped
_GONE = frozenset({1223, 1224, 1239})

_MISSING_LIBRARY = (
    "LabJack's library libLabJackM.so is not installed: install LJM from labjack.com (Software, LJM installer for "
    "Linux), or set `library` to its path"
)
_HINTS: dict[int, tuple[type[protocol.AcquisitionError], str]] = {
    1227: (protocol.DeviceMissingError, "no T7 answers: check cable, power and `serial`"),
    1230: (protocol.DeviceMissingError, "another program holds the T7: close it"),
    1239: (protocol.StreamLostError, "the T7 was unplugged or lost power"),
    1301: (protocol.StreamLostError, "the computer fell behind and LJM's buffer is full"),
    1303: (protocol.StreamLostError, "the stream is not running any more"),
    1306: (protocol.StreamLostError, "the T7's packets stopped in the middle of a scan"),
    1309: (protocol.StreamLostError, "the T7 sends no scans"),
    2605: (protocol.StreamLostError, "a stream is already active on this T7: another program may use it"),
    2606: (protocol.SetupRefusedError, "the T7 refuses the stream set-up: check rate, channels and resolution_index"),
    2942: (
        protocol.SetupRefusedError,
        "a scan takes longer than the scan period: lower rate, channels or resolution_index",
    ),
    1250: (protocol.SetupRefusedError, "a terminal is not an analogue input of the T7: use AIN0 to AIN13"),
    1294: (protocol.SetupRefusedError, "a terminal or register name is unknown to LJM: use AIN0 to AIN13"),
}


def load_ljm(path: str = "") -> ModuleType:
    """Return the module `labjack.ljm.ljm` with its library loaded; LibraryMissingError otherwise.

    The package looks once, while it is imported, and only prints a line where it finds nothing, so a library that was
    installed since is put in place here. `path` is loaded first; the package then finds it by its soname.
    """
    try:
        if path:
            ctypes.CDLL(path)
        with contextlib.redirect_stdout(io.StringIO()), extras("LabJack", protocol.LibraryMissingError):
            module = importlib.import_module("labjack.ljm.ljm")
        if module._staticLib is None:
            vars(module)["_staticLib"] = ctypes.CDLL("libLabJackM.so")
    except OSError as error:
        detail = f" (tried {path!r}: {error})" if path else ""
        raise protocol.LibraryMissingError(_MISSING_LIBRARY + detail) from None
    return module


def skew_s(rate: float, channels: int) -> tuple[float, ...]:
    """Return each channel's delay after the scan [s]: 15 us from one to the next, 8 us above 60 kS/s in all."""
    step = 8e-6 if rate * channels > 60e3 else 15e-6
    return tuple(step * position for position in range(channels))


def call(ljm: ModuleType, name: str, *arguments: object) -> Any:
    """Call LJM; raise its errors as an AcquisitionError: one line, the code, what to do."""
    try:
        return getattr(ljm, name)(*arguments)
    except ljm.LJMError as error:
        kind, hint = _HINTS.get(error.errorCode, (protocol.StreamLostError, "see LabJack's list of LJM error codes"))
        raise kind(f"{hint} (LJM {error.errorCode} {error.errorString})", error.errorCode) from None


class T7:
    """A T7 through LJM: what those that read it and those that write to it share."""

    _ljm: ModuleType
    _handle: int | None = None
    close: Callable[[], None]

    def _connect(self, library: str, connection: str, serial: int) -> int:
        """Connect to the T7 asked for, failing that to any, so that a wrong one is distinguished from none.

        Return the serial number found. Raises WrongDeviceError.
        """
        self._ljm = load_ljm(library)
        self._handle = None
        if serial:
            with contextlib.suppress(protocol.DeviceMissingError):
                self._handle = int(call(self._ljm, "openS", "T7", connection, serial))
        if self._handle is None:
            self._handle = int(call(self._ljm, "openS", "T7", connection, "ANY"))
        found = int(self._call("getHandleInfo")[2])
        if serial not in (0, found):
            self.close()
            raise protocol.WrongDeviceError(f"the T7 has serial number {found}, expected {serial}: set `serial`")
        return found

    def _call_ignoring(self, codes: frozenset[int], name: str) -> None:
        if self._handle is None:
            return
        try:
            self._call(name)
        except protocol.AcquisitionError as error:
            if error.code not in codes:
                raise

    def _call(self, name: str, *arguments: object) -> Any:
        return call(self._ljm, name, self._handle, *arguments)


class LabJackAcquisition(T7, Device[LabJackSettings]):
    """One T7. See Acquisition for what each call promises."""

    def open(self) -> DeviceIdentity:
        """Connect over `connection` and check the serial number."""
        settings = self._settings
        serial = self._connect(settings.library, settings.connection, settings.serial)
        return DeviceIdentity("labjack", serial)

    def start(self) -> float:
        """Write the set-up registers and start streaming; return the actual rate."""
        settings = self._settings
        self._configure()
        terminals = [channel.terminal for channel in settings.channels]
        addresses = call(self._ljm, "namesToAddresses", len(terminals), terminals)[0]
        arguments = (settings.scans_per_block, len(addresses), addresses, settings.rate)
        return self._started(float(self._call("eStreamStart", *arguments)))

    def skew(self) -> tuple[float, ...]:
        """Return the delays: the T7 has one converter, which samples the channels one after the other."""
        return skew_s(self._rate or self._settings.rate, len(self._settings.channels))

    def _take(self) -> tuple[Volts, int]:
        """Wait in LJM, which a read error stops; -9999 V becomes NaN and is counted."""
        data, device_backlog, host_backlog = self._call("eStreamRead")
        volts = np.array(data, dtype=np.float64).reshape(-1, len(self._settings.channels))
        lost = volts == _DUMMY_VOLTS
        if lost.any():
            volts[lost] = np.nan
            self._dropped += int(lost.any(axis=1).sum())
        return volts, max(0, device_backlog) + max(0, host_backlog)

    def stop(self) -> None:
        """Stop the stream; a stream that stopped by itself, or a device that is gone, is stopped too."""
        self._rate = None
        self._call_ignoring(STOPPED_ALREADY | _GONE, "eStreamStop")

    def close(self) -> None:
        """Close the handle."""
        self._rate = None
        self._call_ignoring(_GONE | STOPPED_ALREADY, "close")
        self._handle = None

    def _configure(self) -> None:
        settings = self._settings
        registers: dict[str, float] = {
            "AIN_ALL_RANGE": settings.voltage_range,
            "AIN_ALL_NEGATIVE_CH": 199.0,  # against ground
            "STREAM_SETTLING_US": settings.settling_us,
            "STREAM_RESOLUTION_INDEX": float(settings.resolution_index),
            "STREAM_BUFFER_SIZE_BYTES": float(_BUFFER_BYTES),
            "STREAM_TRIGGER_INDEX": 0.0,
            "STREAM_CLOCK_SOURCE": 0.0,
        }
        # After a program that was killed the stream still runs, and the stream registers cannot be written.
        self._call_ignoring(STOPPED_ALREADY, "eStreamStop")
        self._call("eWriteNames", len(registers), list(registers), list(registers.values()))
