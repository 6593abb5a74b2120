# SPDX-License-Identifier: Apache-2.0
"""A serial port through pyserial, with one-line errors."""

import errno

import serial

from atpid_driver.motor.errors import LinkError

WRITE_TIME = 0.5


class SerialPort:
    """An exclusively locked port; what fails raises `LinkError`."""

    def __init__(self, name: str, baud: int) -> None:
        """Open `name`, best /dev/serial/by-id/..., and clear its buffers."""
        self._name = name
        self._rest = bytearray()
        try:
            self._port = serial.Serial(name, baud, timeout=0, write_timeout=WRITE_TIME, exclusive=True)
            self._port.reset_input_buffer()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(_opening(name, error)) from None

    def write(self, data: bytes) -> None:
        """Send all bytes. Raises `LinkError` if the port is gone."""
        try:
            self._port.write(data)
        except OSError as error:
            raise LinkError(self._gone(error)) from None

    def read_line(self, timeout: float) -> bytes:
        """Return bytes up to and with a line end; b"" if none came within `timeout` [s], the rest is kept."""
        try:
            self._port.timeout = timeout
            self._rest += self._port.read_until(b"\n", 256)
        except (OSError, TypeError) as error:  # pyserial raises TypeError for a closed descriptor
            raise LinkError(self._gone(error)) from None
        if not self._rest.endswith(b"\n") and len(self._rest) < 256:
            return b""
        line, self._rest = bytes(self._rest), bytearray()
        return line

    def close(self) -> None:
        """Close the port, even one that is gone."""
        try:
            self._port.close()
        except OSError:
            self._port.fd = None  # nothing is left to close

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
