# SPDX-License-Identifier: Apache-2.0
"""Shows the progress of a run: simulated time and how much faster than real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def shown(duration: float, label: str) -> Iterator[Callable[[float], None]]:
    """Yield a function that shows the time reached [s] of `duration` [s]; the bar goes to standard error."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:5.1f} of {task.total:g} s"),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=duration, speed="")
        begun: float | None = None

        def update(reached: float) -> None:
            nonlocal begun
            now = time.monotonic()
            begun = now if begun is None else begun
            speed = f"{reached / (now - begun):.1f} x real time" if now > begun else ""
            bar.update(task, completed=min(reached, duration), speed=speed)

        yield update
