# SPDX-License-Identifier: Apache-2.0
"""Acquisition devices behind one protocol (`Acquisition`): LabJack T7, NI-9230, simulated."""

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
from atpid_driver.acquisition.registry import Backend, backend, create
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.acquisition.settings import Channel, Settings, setting

__all__ = [
    "Acquisition",
    "AcquisitionError",
    "Backend",
    "Backoff",
    "Block",
    "Channel",
    "DeviceMissingError",
    "DriftMeter",
    "HardwareClock",
    "Identity",
    "LibraryMissingError",
    "NotStreamingError",
    "Reader",
    "Settings",
    "SetupRefusedError",
    "Status",
    "StreamLostError",
    "WrongDeviceError",
    "backend",
    "backend_names",
    "create",
    "setting",
]
