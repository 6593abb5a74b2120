# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Moving displays of the commands, on standard error and only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

#: The time left is by the steps of so long [s]: one step of a campaign may take minutes.
_REMEMBERED = 3600.0

if TYPE_CHECKING:  # loaded where something is shown: a command whose output is read by a program starts sooner
    from rich import progress


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show `text`, a spinner and the time elapsed until the block ends."""
    if not sys.stderr.isatty():
        yield
        return
    from rich import progress

    with _progress(progress.SpinnerColumn(), _text(), progress.TimeElapsedColumn()) as display:
        display.add_task(text, total=None)
        yield


@contextmanager
def counting(text: str, total: int, kept: bool = False) -> Iterator[Callable[[int], None]]:
    """Show a bar of `total` steps until the block ends; yield a function that takes the number done.

    `kept`: the last state stays, and is printed where there is no terminal as well.
    """
    from rich import progress

    times = (progress.TimeElapsedColumn(), progress.TimeRemainingColumn())
    with _progress(_text(), progress.BarColumn(), progress.MofNCompleteColumn(), *times, kept=kept) as display:
        task = display.add_task(text, total=total)
        yield lambda done: display.update(task, completed=done)


def _text() -> progress.TextColumn:
    from rich import progress

    return progress.TextColumn("{task.description}", markup=False)


def _progress(*columns: progress.ProgressColumn, kept: bool = False) -> progress.Progress:
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    off, speed = not (kept or console.is_terminal), _REMEMBERED
    return progress.Progress(*columns, console=console, transient=not kept, disable=off, speed_estimate_period=speed)
