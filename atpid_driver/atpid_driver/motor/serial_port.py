# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serial port of the board: exclusively locked, and read by a thread that others can wake."""

import errno
import os
import select
import time
from contextlib import suppress

import serial

from atpid_driver.motor.faults import LinkError

_LONGEST_LINE = 256


class SerialPort:
    """An exclusively locked port; what fails raises `LinkError`."""

    def __init__(self, name: str, baud: int) -> None:
        """Open `name`, best /dev/serial/by-id/..., and clear its buffers."""
        self._name = name
        self._rest = bytearray()
        try:
            self._port = serial.Serial(name, baud, timeout=0, exclusive=True)
            self._port.reset_input_buffer()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(_opening(name, error)) from None
        self._awake, self._waker = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def write(self, data: bytes) -> None:
        """Send bytes without waiting: a full buffer loses them, as a bad line. Raises `LinkError` if it is gone."""
        try:
            os.write(self._port.fileno(), data)
        except BlockingIOError:
            return
        except (OSError, TypeError, ValueError) as error:  # of a closed descriptor
            raise LinkError(self._gone(error)) from None

    def read_line(self, timeout: float) -> bytes:
        """Return bytes up to and with a line end; b"" where none came within `timeout` [s], or `wake` was called."""
        end = time.monotonic() + timeout
        while (line := self._line()) is None:
            try:
                left = max(0.0, end - time.monotonic())
                ready, _, _ = select.select([self._port.fileno(), self._awake], [], [], left)
                if self._awake in ready:
                    os.read(self._awake, 4096)
                    return b""
                if not ready:
                    return b""
                self._rest += self._port.read(_LONGEST_LINE)
            except (OSError, TypeError, ValueError) as error:  # of a closed descriptor
                raise LinkError(self._gone(error)) from None
        return line

    def _line(self) -> bytes | None:
        place = self._rest.find(b"\n") + 1
        if not place and len(self._rest) < _LONGEST_LINE:
            return None
        place = place or len(self._rest)
        line = bytes(self._rest[:place])
        del self._rest[:place]
        return line

    def wake(self) -> None:
        """Let `read_line` return at once, or when it is called next; from any thread while the port is open."""
        with suppress(BlockingIOError):  # it is awake
            os.write(self._waker, b"\0")

    def close(self) -> None:
        """Close the port, even one that is gone."""
        try:
            self._port.close()
        except OSError:
            self._port.fd = None  # nothing is left to close
        os.close(self._awake)
        os.close(self._waker)

    def _gone(self, error: Exception) -> str:
        return f"{self._name} is gone ({error}): plugged out? waiting for it to come back"


def _opening(name: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    text = str(error)
    if number == errno.ENOENT or "No such file" in text:
        return f"{name} is not there: board unplugged, or wrong name (ls /dev/serial/by-id)"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return f"{name} is taken by another program: close it first (fuser {name})"
    if number == errno.EACCES:
        return f"{name} may not be opened: add the user to the group dialout, log in again"
    return f"{name} cannot be opened: {text}"
