# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Acquisition devices behind one protocol (`Acquisition`): LabJack T7, NI-9230, simulated.

The names here are those that a backend of another distribution is written with (docs/extend.md).
"""

from atpid_common.parameters import setting
from atpid_driver.acquisition.protocol import (
    Acquisition,
    AcquisitionError,
    AcquisitionSettings,
    Block,
    Channel,
    DeviceIdentity,
    DeviceMissingError,
    LibraryMissingError,
    NotStreamingError,
    SetupRefusedError,
    StreamLostError,
    WrongDeviceError,
)
from atpid_driver.acquisition.registry import Backend

__all__ = [
    "Acquisition", "AcquisitionError", "AcquisitionSettings", "Backend", "Block", "Channel", "DeviceIdentity",
    "DeviceMissingError", "LibraryMissingError", "NotStreamingError", "SetupRefusedError", "StreamLostError",
    "WrongDeviceError", "setting",
]  # fmt: skip
