# SPDX-License-Identifier: Apache-2.0
"""Moving displays of the commands, on standard error and only on a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress
from rich.console import Console

_TEXT = progress.TextColumn("{task.description}", markup=False)


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show `text`, a spinner and the time elapsed until the block ends."""
    with _progress(progress.SpinnerColumn(), _TEXT, progress.TimeElapsedColumn()) as display:
        display.add_task(text, total=None)
        yield


@contextmanager
def counting(text: str, total: int, kept: bool = False) -> Iterator[Callable[[int], None]]:
    """Show a bar of `total` steps until the block ends; yield a function that takes the number done.

    `kept`: the last state stays, and is printed where there is no terminal as well.
    """
    times = (progress.TimeElapsedColumn(), progress.TimeRemainingColumn())
    with _progress(_TEXT, progress.BarColumn(), progress.MofNCompleteColumn(), *times, kept=kept) as display:
        task = display.add_task(text, total=total)
        yield lambda done: display.update(task, completed=done)


def _progress(*columns: progress.ProgressColumn, kept: bool = False) -> progress.Progress:
    console = Console(stderr=True)
    return progress.Progress(*columns, console=console, transient=not kept, disable=not (kept or console.is_terminal))
