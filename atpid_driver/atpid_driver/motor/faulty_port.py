# SPDX-License-Identifier: Apache-2.0
"""A serial port whose line fails as injected: between the host, which is real, and the board, which is too."""

import random
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from atpid_common.injected_faults import Injected
from atpid_driver.motor.errors import ProtocolError
from atpid_driver.motor.protocol import decode, encode, micrometres

#: Between two looks whether the fault has begun or ended [s].
_LOOK = 0.01
#: Where the height stands among the arguments of a state.
_HEIGHT = 3


class Port(Protocol):
    """What a session needs of a port."""

    def write(self, data: bytes) -> None:
        """Send all bytes."""

    def read_line(self, timeout: float) -> bytes:
        """Return bytes up to and with a line end; b"" if none came within `timeout` [s]."""

    def close(self) -> None:
        """Close the port."""


class FaultyPort:
    """Acts the faults of `serial_link` on both directions; their times are those of the steady clock [s]."""

    def __init__(self, port: Port, injected: Callable[[], Sequence[Injected]]) -> None:
        """Stand before `port`. `injected` returns the faults in force: they may change while it is open."""
        self._port, self._injected = port, injected
        self._random = random.Random(0)
        self._last = b""  # answer before the fault
        self._late: list[tuple[float, bytes]] = []  # answers on their way: when each arrives [s]

    def write(self, data: bytes) -> None:
        """Send the bytes as far as the line lets them pass. Raises `LinkError` if the port is gone."""
        fault = self._fault()
        if fault is None:
            self._port.write(data)
        elif fault.kind == "garbage":
            # three of the character ! would enter the bootloader's monitor
            self._port.write(self._random.randbytes(len(data)).replace(b"!", b"?"))
        elif not _interrupted(fault):
            time.sleep(len(data) / fault.value if fault.kind == "slow" else 0.0)
            self._port.write(data)

    def read_line(self, timeout: float) -> bytes:
        """Return the next answer as it arrives; b"" if none does within `timeout` [s]."""
        if not self._injected() and not self._late:
            return self._port.read_line(timeout)
        end = time.monotonic() + timeout
        while True:
            now = time.monotonic()
            if self._late and self._late[0][0] <= now:
                return self._late.pop(0)[1]
            if now >= end:
                return b""
            line = self._port.read_line(min(_LOOK, end - now))
            if line:
                self._pass(line)

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _fault(self) -> Injected | None:
        now = time.monotonic()
        return next((fault for fault in self._injected() if fault.active(now)), None)

    def _pass(self, line: bytes) -> None:
        """Put an answer of the board on its way."""
        fault, now = self._fault(), time.monotonic()
        kind, arrival = fault.kind if fault else "", now
        if fault is None:
            self._last = line
        elif _interrupted(fault):
            return
        elif kind == "stuck":
            line = self._last
        elif kind == "garbage":
            line = self._random.randbytes(len(line))
        elif kind == "wrong":
            line = _raised(line, fault.value)
        elif kind == "delayed":
            arrival = now + fault.value
        elif kind == "slow":
            arrival = max(now, self._late[-1][0] if self._late else now) + len(line) / fault.value
        self._late.append((max(arrival, self._late[-1][0]) if self._late else arrival, line))


def _interrupted(fault: Injected) -> bool:
    """Whether nothing passes now."""
    if fault.kind == "intermittent":
        return (time.monotonic() - fault.begin) % fault.value >= 0.5 * fault.value
    return fault.kind == "off"


def _raised(line: bytes, by: float) -> bytes:
    """Return the state in `line` with another height [m], its check sum right; any other answer as it is."""
    try:
        frame = decode(line)
    except ProtocolError:
        return line
    arguments = list(frame.arguments)
    if frame.word != "ST" or arguments[_HEIGHT] == "-":
        return line
    arguments[_HEIGHT] = str(int(arguments[_HEIGHT]) + micrometres(by))
    return encode(frame.sequence, frame.word, *arguments)
