# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a refusal has to have: one line with the key, the value given and what is allowed."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from sim_program import main


@contextmanager
def refused(kind: type[Exception], *parts: str) -> Iterator[None]:
    """Expect an error whose message is one line with all `parts` in it."""
    with pytest.raises(kind) as caught:
        yield
    has_parts(str(caught.value), parts)


def has_parts(line: str, parts: tuple[str, ...]) -> None:
    """Check that a text is one line and has all parts."""
    assert "\n" not in line
    assert [part for part in parts if part not in line] == [], line


def command_refused(capsys: pytest.CaptureFixture[str], arguments: list[str], status: int, *parts: str) -> None:
    """Expect a command to end with a status, nothing on stdout, and one line with all `parts` on stderr."""
    assert main(arguments) == status
    output = capsys.readouterr()
    assert output.out == ""
    has_parts(output.err.removesuffix("\n"), parts)
