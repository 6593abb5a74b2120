# SPDX-License-Identifier: Apache-2.0
"""Base classes of the errors that are reported to the user in one line instead of a traceback."""

DONE, BROKEN_PIPE, BAD_INPUT, NUMERICAL_FAILURE, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses of commands and nodes. 1 after a broken pipe is what the Python documentation advises."""


class AtpidError(Exception):
    """An error with a one-line text for the user and an exit status."""

    status = BAD_INPUT


class InputError(AtpidError, ValueError):
    """Bad input: the text states what was given, what is allowed and what to do."""


class NumericalError(AtpidError, ArithmeticError):
    """A computation that failed; its result does not exist or cannot be trusted."""

    status = NUMERICAL_FAILURE
