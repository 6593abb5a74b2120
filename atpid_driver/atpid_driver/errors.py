# SPDX-License-Identifier: Apache-2.0
"""The base of what is said to a user in one line instead of a traceback."""

from atpid_common.errors import InputError


class DriverError(InputError):
    """Bad input, or hardware that is not as expected: what was given, what is allowed, what to do."""
