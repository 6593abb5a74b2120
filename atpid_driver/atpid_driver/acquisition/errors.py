# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors of an acquisition device, one line each: what happened, what is expected, what to do."""

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
