# SPDX-License-Identifier: Apache-2.0
"""Calibration as data: files, conversion, and making them from readings."""

from atpid_driver.calibration.convert import Counts, block_si, check_channels, si_of, volts_of
from atpid_driver.calibration.model import Calibration, CalibrationError, load, save

__all__ = [
    "Calibration",
    "CalibrationError",
    "Counts",
    "block_si",
    "check_channels",
    "load",
    "save",
    "si_of",
    "volts_of",
]
