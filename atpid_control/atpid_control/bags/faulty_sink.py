# SPDX-License-Identifier: Apache-2.0
"""A bag's file on a disk that fails as injected, and the watch that finds a disk that keeps the recorder waiting."""

import errno
import os
import random
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from atpid_common.injected_faults import Injected
from atpid_control.bags.writer import Sink

#: Between two looks whether the disk still hangs [s].
_LOOK = 0.01


class FaultySink(Sink):
    """Acts the faults of `recorder` but its death; their times are those of the run."""

    def __init__(self, path: Path, faults: Sequence[Injected], elapsed: Callable[[], float]) -> None:
        """Create the file. `elapsed` returns the time of the run [s], NaN before its begin."""
        super().__init__(path)
        self._faults, self._elapsed = faults, elapsed
        self._random = random.Random(0)
        self._order = threading.RLock()  # flushes are made in a thread of their own
        self._under_way: list[tuple[float, bytes]] = []  # when each piece is in the file, steady [s]

    def sync(self) -> None:
        """Flush to the disk: what is under way first."""
        while (due := self._next_due()) is not None:
            time.sleep(max(0.0, due - time.monotonic()))
            self._arrive()
        self._wait()
        super().sync()

    def close(self) -> None:
        """Close the file with all that was written; twice does nothing."""
        with self._order:
            for _, data in self._under_way:
                super()._append(data)
            self._under_way.clear()
        super().close()

    def _append(self, data: bytes) -> None:
        self._wait()
        self._arrive()
        fault = self._fault()
        kind = fault.kind if fault else ""
        if kind == "wrong":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if kind == "garbage" and data:
            flipped = bytearray(data)
            flipped[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
            data = bytes(flipped)
        if fault and kind == "slow":
            time.sleep(fault.value)
        with self._order:
            if fault and kind == "delayed":
                self._under_way.append((time.monotonic() + fault.value, data))
            elif self._under_way:  # nothing overtakes
                self._under_way.append((self._under_way[-1][0], data))
            else:
                super()._append(data)

    def _next_due(self) -> float | None:
        with self._order:
            return self._under_way[0][0] if self._under_way else None

    def _arrive(self) -> None:
        with self._order:
            while self._under_way and self._under_way[0][0] <= time.monotonic():
                super()._append(self._under_way.pop(0)[1])

    def _fault(self) -> Injected | None:
        elapsed = self._elapsed()
        return next((fault for fault in self._faults if fault.active(elapsed)), None)

    def _wait(self) -> None:
        """Wait as long as the disk hangs."""
        while (fault := self._fault()) is not None and (
            fault.kind == "stuck"
            or (fault.kind == "intermittent" and (self._elapsed() - fault.begin) % fault.value >= 0.5 * fault.value)
        ):
            time.sleep(_LOOK)


class DiskWatch:
    """Finds when writing begins to keep the recorder waiting, and when it no longer does."""

    def __init__(self, slow: float, again: float) -> None:
        """Call a write slow that takes longer than `slow` [s], and the disk well after `again` [s] without one."""
        self._slow, self._again = slow, again
        self._until = 0.0  # [s]; 0: the disk is well
        self.longest = 0.0  # write [s]

    def push(self, took: float, now: float) -> bool | None:
        """Take how long a write took [s]; return True where slow ones begin, False where they end, else None."""
        self.longest = max(self.longest, took)
        if took > self._slow:
            before, self._until = self._until, now + self._again
            return None if before else True
        if self._until and now > self._until:
            self._until = 0.0
            return False
        return None
