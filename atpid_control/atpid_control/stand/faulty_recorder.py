# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorder with its bag on a disk that fails as its scene has it; the bench alone starts it, in its place."""

import errno
import math
import os
import random
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from atpid_common.injected_faults import RECORDER, Injected, active_fault
from atpid_common.nodes.node_main import run_node
from atpid_control.nodes.recorder_node import GATHER, RecorderNode
from atpid_control.runs.writer import Sink
from atpid_sim.scene import load_scene

#: Between two looks whether the disk still hangs [s].
_LOOK = 0.01


class FaultySink(Sink):
    """A file into which faults of `recorder` are injected, all but its death; their times are those of the run."""

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
        return active_fault(self._faults, self._elapsed())

    def _wait(self) -> None:
        """Wait as long as the disk hangs."""
        while (fault := self._fault()) is not None and (fault.kind == "stuck" or fault.gap(self._elapsed())):
            time.sleep(_LOOK)


class FaultyRecorder(RecorderNode):
    """The recorder, whose file is on such a disk."""

    def __init__(self, **node_options: object) -> None:
        super().__init__(**node_options)
        scene = load_scene(Path(self._values["scene"]))
        self._faults = [fault for fault in scene.injected if fault.part in RECORDER]

    def _sink(self, path: Path) -> Sink:
        return FaultySink(path, self._faults, lambda: self.session.elapsed if self.session else math.nan)


if __name__ == "__main__":
    sys.exit(run_node(FaultyRecorder, gather=GATHER))
