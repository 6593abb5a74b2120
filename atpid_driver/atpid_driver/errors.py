# SPDX-License-Identifier: Apache-2.0
"""Base class of the driver's errors."""

from typing import ClassVar

from atpid_common.errors import InputError


class DriverError(InputError):
    """Bad input, or hardware that is not as expected: what was given, what is allowed, what to do."""

    retry: ClassVar[bool] = True  # whether trying again later may help, with the same parameters
