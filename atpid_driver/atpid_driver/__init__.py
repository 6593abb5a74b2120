# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The hardware of the tuned particle impact damper: LabJack, NI and motor drivers, calibration, stand-ins."""

from typing import ClassVar

from atpid_common.errors import InputError


class DriverError(InputError):
    """Bad input, or hardware that is not as expected: what was given, what is allowed, what to do."""

    retry: ClassVar[bool] = True  # whether trying again later may help, with the same parameters


class SettingsError(DriverError):
    """A parameter of a node is missing or impossible."""


class NotReadyError(DriverError):
    """A command while the device may not follow one: not armed, not homed, not permitted, or in a fault."""
