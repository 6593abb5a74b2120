# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator's stop at the keyboard: Enter, at the terminal in which a run was started."""

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from atpid_common.waiting import to_stderr

#: Between two looks whether a run that was sent to the background is in the foreground again [s].
_AGAIN = 0.2


@contextmanager
def stop_key(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop`, in another thread, at each Enter; without a terminal there is no key, and nothing is announced.

    A thread, so that no other work delays it.
    """
    if not _in_foreground():
        yield
        return
    to_stderr("Enter stops the motor; Ctrl-C ends the run")
    end, ended = os.pipe()
    thread = threading.Thread(target=_wait, args=(end, stop), name="stop key", daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.close(ended)
        thread.join()
        os.close(end)


def _in_foreground() -> bool:
    """Whether standard input is a terminal that belongs to this process now: another one must not read it."""
    with suppress(OSError, ValueError, AttributeError):  # no standard input at all
        return os.isatty(sys.stdin.fileno()) and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    return False


def _wait(end: int, stop: Callable[[], None]) -> None:
    terminal = sys.stdin.fileno()
    while True:
        watched = [end, terminal] if _in_foreground() else [end]
        ready, _, _ = select.select(watched, [], [], _AGAIN)
        if end in ready:
            return
        if terminal in ready and _in_foreground():
            with suppress(OSError):
                if not os.read(terminal, 4096):
                    return  # closed
            stop()
