# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with an acquisition device, in one line each: what happened, what is expected, what to do."""

from __future__ import annotations

from typing import ClassVar

from atpid_driver.errors import DriverError


class AcquisitionError(DriverError):
    """A device could not be opened, set up or read."""

    retry: ClassVar[bool] = True
    """Whether trying again later may help without anybody changing a parameter."""

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code
        """The vendor's error code, None where the driver itself found the fault."""


class LibraryMissingError(AcquisitionError):
    """The vendor's library is not installed."""


class DeviceMissingError(AcquisitionError):
    """No device answers where one is expected."""


class WrongDeviceError(AcquisitionError):
    """A device answers, but not the one that was asked for."""


class StreamLostError(AcquisitionError):
    """A running stream ended by itself: unplugged, overrun, stalled."""


class NotStreamingError(AcquisitionError):
    """A block was asked for while no stream is running."""

    retry = False


class SetupRefusedError(AcquisitionError):
    """The device cannot do what was asked: rate, channel, range."""

    retry = False
