# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What set-up prints while a step runs. Standard library only."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def step(text: str) -> Iterator[None]:
    """Print what is being done, then how many seconds it took; on a terminal the seconds are counted meanwhile."""
    begin = time.monotonic()
    ended = threading.Event()

    def count() -> None:
        while not ended.wait(1.0):
            print(f"\r  {text} ... {time.monotonic() - begin:.0f} s", end="", flush=True)

    counter = threading.Thread(target=count, name="step", daemon=True)
    print(f"  {text} ...", end="", flush=True)
    terminal = sys.stdout.isatty()
    if terminal:
        counter.start()
    try:
        yield
    except BaseException:
        _stop(counter, ended)
        print(flush=True)
        raise
    _stop(counter, ended)
    again = f"\r  {text} ..." if terminal else ""
    print(f"{again} {time.monotonic() - begin:.0f} s", flush=True)


def _stop(counter: threading.Thread, ended: threading.Event) -> None:
    ended.set()
    if counter.is_alive():
        counter.join()
