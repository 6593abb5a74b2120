# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulated board beside a run of the stand: hardware, which no other program delays, and which can be asked."""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from atpid_control.stand.errors import BenchError
from atpid_driver.emulator.emulator import StandState

#: Real-time priority of what is hardware on a stand, above the loop's nodes.
_HARDWARE = 20


class EmulatedBoard:
    """The emulated board with its line, at a real-time priority of its own where that is allowed."""

    def __init__(self, command: list[str], log: Path) -> None:
        """Start it; log: file of its messages. Raises BenchError where it does not start."""
        with log.open("wb") as errors, _prioritised():
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, bufsize=1,
                start_new_session=True,
            )  # fmt: skip
        self._log = log
        self._line()

    def do(self, command: str) -> str:
        """Carry out a command of the emulator; return its answer. Raises BenchError where it has ended."""
        assert self._process.stdin is not None
        with suppress(OSError):  # it has ended, which the missing answer shows
            self._process.stdin.write(f"{command}\n")
        return self._line()

    def state(self) -> StandState:
        """Return the true state of board and stand. Raises BenchError where the emulator has ended."""
        values = json.loads(self.do("state"))
        return StandState(**values | {"open": bool(values["open"])})

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):  # commands not yet sent
                    stream.close()

    def _line(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise BenchError(f"the emulated board has ended, or did not start: see {self._log}")
        return line.strip()


@contextmanager
def _prioritised() -> Iterator[None]:
    """Give what is started meanwhile a real-time priority, where that is allowed."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_HARDWARE))
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
