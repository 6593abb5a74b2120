# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Flushes of a bag's files to the disk, which nothing that is written waits for; and a watch for a slow disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor


class Flush:
    """One thread that flushes files one after the other; it is there from the first flush on.

    A killed process loses nothing that it handed to the kernel: only a power cut does, and only for it is flushed.
    """

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._last: Future[None] | None = None
        self._begun = self._took = 0.0  # [s]

    @property
    def seconds(self) -> float:
        """How long the flush under way has taken so far, or the last one took [s]."""
        if self._last is None or self._last.done():
            return self._took
        return time.monotonic() - self._begun

    def start(self, act: Callable[[], None]) -> None:
        """Let `act` flush, unless the flush before has not ended. Raises OSError of that before."""
        if self._last is None or self._last.done():
            self.add(act)

    def add(self, act: Callable[[], None]) -> None:
        """Let `act` flush, after the flush before. Raises OSError of that before, where it has ended."""
        if self._last is not None and self._last.done():
            self._last.result()
        self._thread = self._thread or ThreadPoolExecutor(1, "flush")
        before = self._last
        self._last = self._thread.submit(self._run, before, act)

    def finish(self) -> None:
        """Wait until all is flushed, and end the thread. Raises OSError."""
        last, thread = self._last, self._thread
        self._last = self._thread = None
        if thread is not None:
            thread.shutdown()
        if last is not None:
            last.result()

    def abandon(self) -> None:
        """End the thread once the flush under way has ended, which is not waited for."""
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)
        self._thread = self._last = None

    def _run(self, before: Future[None] | None, act: Callable[[], None]) -> None:
        if before is not None:
            before.result()  # an error of it is that of all that follow
        self._begun = time.monotonic()
        try:
            act()
        finally:
            self._took = time.monotonic() - self._begun


class DiskWatch:
    """Finds when writing begins to keep the recorder waiting, and when it no longer does.

    Where slow writes soon come back, each time twice as long has to pass without one, so that a disk that is busy for
    an hour is a few reports, not thousands.
    """

    def __init__(self, slow: float, again: float, longest: float) -> None:
        """Call a write slow that takes longer than `slow` [s], and the disk well after `again` to `longest` [s]."""
        self._slow, self._least, self._most = slow, again, longest
        self._again = again
        self._until, self._well = 0.0, -longest  # when it will be well, 0: it is; since when it is [s]
        self.longest = 0.0  # write [s]

    def push(self, took: float, now: float) -> bool | None:
        """Take how long a write took [s]; return True where slow ones begin, False where they end, else None."""
        self.longest = max(self.longest, took)
        if took > self._slow:
            before = self._until
            if not before:
                self._again = min(2.0 * self._again, self._most) if now - self._well < self._most else self._least
            self._until = now + self._again
            return None if before else True
        if self._until and now > self._until:
            self._until, self._well = 0.0, now
            return False
        return None
