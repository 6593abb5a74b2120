# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Announces what takes long: nothing is printed where it is quick."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: How long the user is left without an explanation [s].
ANNOUNCE_AFTER = 2.0
COMPILING = "loading the numerical kernels (compiled in the first run after an installation, about a minute)"


def to_stderr(text: str) -> None:
    """Print one line on standard error."""
    print(text, file=sys.stderr, flush=True)


@contextmanager
def announced(text: str, report: Callable[[str], None] = to_stderr, after: float = ANNOUNCE_AFTER) -> Iterator[None]:
    """Report `text` where the block takes longer than `after` [s], and its duration at its end.

    text: what is being done, for example "compiling the numerical kernels (only the first run after an update)".
    report: called from another thread.
    """
    begun, done = time.monotonic(), threading.Event()

    def wait() -> None:
        if not done.wait(after):
            report(f"{text} ...")

    waiter = threading.Thread(target=wait, name="announcement", daemon=True)
    waiter.start()
    try:
        yield
    finally:
        done.set()
        waiter.join()
    taken = time.monotonic() - begun
    if taken > after:
        report(f"{text}: done after {taken:.0f} s")
