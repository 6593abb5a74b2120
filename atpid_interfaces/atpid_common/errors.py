# SPDX-License-Identifier: Apache-2.0
"""Base classes of the errors that are reported to the user in one line instead of a traceback."""

DONE, BROKEN_PIPE, BAD_INPUT, NUMERICAL_FAILURE, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses of commands and nodes. 1 after a broken pipe is what the Python documentation advises."""


#: Longest text of an error: what was given may be a whole file.
_LONGEST = 2000


def one_line(text: str) -> str:
    """Return a text as it is printed in one line: what a user gave may hold line breaks and control characters."""
    shown = text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 2 :]}"
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in shown)


class AtpidError(Exception):
    """An error with a one-line text for the user and an exit status."""

    status = BAD_INPUT

    def __str__(self) -> str:
        """Return the text, in one line whatever it quotes."""
        return one_line(super().__str__())


class InputError(AtpidError, ValueError):
    """Bad input: the text states what was given, what is allowed and what to do."""


class NumericalError(AtpidError, ArithmeticError):
    """A computation that failed; its result does not exist or cannot be trusted."""

    status = NUMERICAL_FAILURE
