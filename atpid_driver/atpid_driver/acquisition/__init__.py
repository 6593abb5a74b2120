# SPDX-License-Identifier: Apache-2.0
"""Acquisition devices behind one role: LabJack T7, NI-9230, simulated."""

from atpid_driver.acquisition.clock import DriftMeter, HardwareClock
from atpid_driver.acquisition.errors import (
    AcquisitionError,
    DeviceMissingError,
    LibraryMissingError,
    NotStreamingError,
    SetupRefusedError,
    StreamLostError,
    WrongDeviceError,
)
from atpid_driver.acquisition.protocol import Acquisition, Block, Identity
from atpid_driver.acquisition.reader import Backoff, Reader, Status
from atpid_driver.acquisition.registry import BACKENDS, create

__all__ = [
    "BACKENDS",
    "Acquisition",
    "AcquisitionError",
    "Backoff",
    "Block",
    "DeviceMissingError",
    "DriftMeter",
    "HardwareClock",
    "Identity",
    "LibraryMissingError",
    "NotStreamingError",
    "Reader",
    "SetupRefusedError",
    "Status",
    "StreamLostError",
    "WrongDeviceError",
    "create",
]
