# SPDX-License-Identifier: Apache-2.0
"""Named errors of the exciter's output: each message is one line with what was given, what is allowed, what to do."""

from atpid_driver import DriverError


class ExcitationError(DriverError):
    """A command or a setting that is refused, or an output that cannot be reached."""


class CommandRefusedError(ExcitationError):
    """A command outside the limits, or one that the backend cannot put out; the output stays as it is."""


class OutputLostError(ExcitationError):
    """The device is missing, taken or has been lost; its output cannot be confirmed."""


class NotReadyError(ExcitationError):
    """A command while the output may not be switched on."""
