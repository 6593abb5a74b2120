# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The one error a scene can raise."""

from atpid_common.errors import InputError


class SceneError(InputError):
    """A scene that cannot be used; the message is one line: file, key, what was given, what is allowed."""

    def __init__(self, message: str) -> None:
        """Write out what does not print in `message`, such as a line's end in a key or a column's name."""
        printable = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
        super().__init__("".join(printable))
