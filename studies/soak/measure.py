# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a run holds of the machine: memory, open files and threads of its processes, shared memory, from /proc."""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from studies.soak.segments import used_by

_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Holding:
    """What one process holds."""

    memory: float  # resident [MB]
    handles: int  # open files
    threads: int


@dataclass(frozen=True)
class Sample:
    """One look at a run."""

    leg: int
    time: float  # of the data, since the leg's begin [s]
    wall: float  # steady clock [s]
    processes: dict[str, Holding]  # by name; in lockstep all nodes are in the one "bench"
    segments: int  # of shared memory, of all these processes

    @property
    def total(self) -> Holding:
        """All processes together."""
        every = self.processes.values()
        return Holding(
            sum(one.memory for one in every), sum(one.handles for one in every), sum(one.threads for one in every)
        )


class Sampler:
    """Looks at this process and those it has started every `period` seconds of data."""

    def __init__(self, period: float) -> None:
        self.period, self.leg = period, 0
        self.samples: list[Sample] = []
        self.segments: set[str] = set()  # all that were ever used
        self._next = 0.0

    def begin(self, leg: int) -> None:
        """Begin a leg."""
        self.leg, self._next = leg, 0.0

    def following(self, shown: Callable[[float], None]) -> Callable[[float], None]:
        """Return a function of the data time [s] that samples when it is due, and passes the time on to `shown`."""

        def progress(reached: float) -> None:
            if reached >= self._next:
                self._next = reached + self.period
                used = set().union(*map(used_by, family()))
                self.segments |= used
                self.samples.append(Sample(self.leg, reached, time.monotonic(), processes(), len(used)))
            shown(reached)

        return progress


def processes(root: int | None = None) -> dict[str, Holding]:
    """Return what process `root`, by default this one, and all below it hold, by name."""
    own = root or os.getpid()
    found: dict[str, Holding] = {}
    for number in family(own):
        with suppress(OSError, ValueError, IndexError):
            name = "bench" if number == own else _name_of(number)
            if name in found:
                name = f"{name} {number}"
            found[name] = holding(number)
    return found


def holding(number: int) -> Holding:
    """Return what one process holds; raise OSError where it has ended."""
    folder = Path(f"/proc/{number}")
    pages = int((folder / "statm").read_text().split()[1])
    return Holding(pages * _PAGE / 1e6, len(os.listdir(folder / "fd")), len(os.listdir(folder / "task")))


def family(root: int | None = None) -> list[int]:
    """Return the process `root`, by default this one, and all below it."""
    found, waiting = list[int](), [root or os.getpid()]
    while waiting:
        found.append(waiting.pop())
        with suppress(OSError):
            for task in Path(f"/proc/{found[-1]}/task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text().split()]
    return found


def _name_of(number: int) -> str:
    """Return the last part of the script or module a process runs."""
    words = Path(f"/proc/{number}/cmdline").read_text(errors="replace").split("\0")
    named = next((word for word in words if word.endswith("_node") or "/lib/" in word), words[0])
    return Path(named).name
