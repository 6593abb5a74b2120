# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What takes long is announced, what is quick is not."""

import threading

import pytest

from atpid_common.waiting import announced


def test_what_is_quick_is_not_announced() -> None:
    lines: list[str] = []
    with announced("compiling", lines.append, after=60.0):
        pass
    assert lines == []


def test_what_takes_long_is_announced_and_its_end_too() -> None:
    lines: list[str] = []
    announcement = threading.Event()

    def report(line: str) -> None:
        lines.append(line)
        announcement.set()

    with announced("compiling", report, after=0.01):
        assert announcement.wait(60.0)
    assert lines[0] == "compiling ..."
    assert lines[1].startswith("compiling: done after ")


def test_an_error_passes_through() -> None:
    with pytest.raises(ValueError, match="inside"), announced("compiling", after=60.0):
        raise ValueError("inside")
