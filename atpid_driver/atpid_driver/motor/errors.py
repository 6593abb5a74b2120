# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Named errors of the motor: each message is one line with what was given, what is allowed and what to do."""

from atpid_driver import DriverError, SettingsError


class LimitsError(SettingsError):
    """The limits asked for are not possible, or not inside those built into the firmware."""


class HeightRefusedError(DriverError):
    """A height outside the limits; the ceiling stays on its present target."""


class CommandStaleError(DriverError):
    """A command that waited longer than the time-out between receipt and execution."""


class LinkError(DriverError):
    """The port is missing, taken, silent or was pulled out."""


class StopNotConfirmedError(LinkError):
    """A stop that the board has not confirmed in time; it goes on being sent."""


class IdentityError(LinkError):
    """The board at the port does not run the firmware of this driver."""


class ProtocolError(DriverError):
    """A frame that breaks the protocol: wrong check sum, form or field."""
