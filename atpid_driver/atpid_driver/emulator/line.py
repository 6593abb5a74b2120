# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A serial line that fails, between a host's port and a board's: a thread that passes frames on from pty to pty.

Both ends are unchanged, the host's software and the firmware: what fails is outside of them. Frames keep their order.
"""

import os
import pty
import random
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from atpid_common.injected_faults import Injected, active_fault
from atpid_driver.motor.faults import ProtocolError
from atpid_driver.motor.protocol import decode, encode, micrometres

#: Between two looks whether the host has opened its port [s].
_LOOK = 0.005
#: Where the height is among the arguments of a state.
_HEIGHT = 3


class Disturbance(Protocol):
    """What a line does to the frames that it passes."""

    def passed(self, frame: bytes, to_board: bool, now: float) -> tuple[float, bytes] | None:
        """Return when a frame arrives [s, steady] and as what; None: never."""


class InjectedFaults:
    """The faults of `serial_link`, whose times count from the first MOVE that the host sends [s]."""

    def __init__(self, faults: Sequence[Injected]) -> None:
        self._faults = faults
        self._random = random.Random(0)
        self._begin: float | None = None
        self._free = {True: 0.0, False: 0.0}  # when a slow line has passed its last byte, to the board and from it
        self._last = b""  # answer before the fault

    def passed(self, frame: bytes, to_board: bool, now: float) -> tuple[float, bytes] | None:
        """See `Disturbance`."""
        if self._begin is None and to_board and b",MOVE," in frame:
            self._begin = now
        since = now - self._begin if self._begin is not None else -1.0
        fault = active_fault(self._faults, since)
        if fault is None:
            self._last = self._last if to_board else frame
            return now, frame
        return self._faulty(fault, frame, to_board, now, since)

    def _faulty(
        self, fault: Injected, frame: bytes, to_board: bool, now: float, since: float
    ) -> tuple[float, bytes] | None:
        kind, arrival = fault.kind, now
        if kind == "off" or fault.gap(since):
            return None
        if kind == "garbage":  # three of the character ! would enter the bootloader's monitor
            frame = self._random.randbytes(len(frame)).replace(b"!", b"?")
        elif kind == "slow":
            arrival = self._free[to_board] = max(now, self._free[to_board]) + len(frame) / fault.value
        elif kind == "delayed" and not to_board:
            arrival = now + fault.value
        elif kind == "stuck" and not to_board:
            frame = self._last
        elif kind == "wrong" and not to_board:
            frame = _raised(frame, fault.value)
        return arrival, frame


class FaultyLine:
    """A port at `link` behind which is the port `board`, opened and closed with it; close it, or use it in `with`."""

    def __init__(self, link: Path, board: Path, disturbance: Disturbance | None = None) -> None:
        self.disturbance: Disturbance = disturbance or InjectedFaults(())
        self.sent: deque[tuple[float, bytes]] = deque(maxlen=10_000)  # the host's frames, when it wrote them [s]
        self._link, self._board = link, board
        self._host, slave = pty.openpty()
        tty.setraw(slave)
        link.symlink_to(os.ttyname(slave))
        os.close(slave)  # from now on the absence of a host is seen
        self._waiting: dict[bool, deque[tuple[float, bytes]]] = {True: deque(), False: deque()}
        self._rest = {True: b"", False: b""}
        self._port = -1  # of the board, while the host has its own open
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="faulty line", daemon=True)
        self._thread.start()

    def __enter__(self) -> "FaultyLine":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread and remove the port."""
        self._closing.set()
        self._thread.join()
        self._release()
        os.close(self._host)
        self._link.unlink(missing_ok=True)

    def _run(self) -> None:
        poll = select.poll()
        poll.register(self._host, select.POLLIN)
        while not self._closing.is_set():
            if any(event & select.POLLHUP for _, event in poll.poll(0)):
                self._release()
                self._closing.wait(_LOOK)
            elif self._port < 0:
                self._open()
            else:
                self._pass()

    def _open(self) -> None:
        try:
            self._port = os.open(self._board, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:  # unplugged
            self._closing.wait(_LOOK)

    def _release(self) -> None:
        if self._port >= 0:
            os.close(self._port)
        self._port, self._rest = -1, {True: b"", False: b""}
        for waiting in self._waiting.values():
            waiting.clear()

    def _pass(self) -> None:
        now = time.monotonic()
        arrivals = [waiting[0][0] for waiting in self._waiting.values() if waiting]
        timeout = min([_LOOK, *(max(0.0, arrival - now) for arrival in arrivals)])
        ready, _, _ = select.select([self._host, self._port], [], [], timeout)
        try:
            for port, to_board in ((self._host, True), (self._port, False)):
                if port in ready:
                    self._take(os.read(port, 4096), to_board)
                self._deliver(self._port if to_board else self._host, to_board)
        except OSError:  # one end is gone
            self._release()

    def _take(self, data: bytes, to_board: bool) -> None:
        if not data:
            raise OSError("the port is gone")
        now, waiting = time.monotonic(), self._waiting[to_board]
        *frames, self._rest[to_board] = (self._rest[to_board] + data).split(b"\n")
        for frame in frames:
            if to_board:
                self.sent.append((now, frame))
            passed = self.disturbance.passed(frame + b"\n", to_board, now)
            if passed is not None:
                earliest = waiting[-1][0] if waiting else passed[0]
                waiting.append((max(passed[0], earliest), passed[1]))

    def _deliver(self, port: int, to_board: bool) -> None:
        waiting, now = self._waiting[to_board], time.monotonic()
        while waiting and waiting[0][0] <= now:
            with suppress(BlockingIOError):  # a full buffer loses frames, as a real one does
                os.write(port, waiting.popleft()[1])


def _raised(frame: bytes, by: float) -> bytes:
    """Return the state in `frame` with another height [m], its check sum right; any other answer as it is."""
    try:
        state = decode(frame)
    except ProtocolError:
        return frame
    arguments = list(state.arguments)
    if state.word != "ST" or arguments[_HEIGHT] == "-":
        return frame
    arguments[_HEIGHT] = str(int(arguments[_HEIGHT]) + micrometres(by))
    return encode(state.sequence, state.word, *arguments)
