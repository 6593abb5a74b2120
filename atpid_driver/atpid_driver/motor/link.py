# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The I/O thread to the board: opens the port, writes what the dialogue has due, reads, reconnects with backoff.

Each frame is decided on and written under the lock by which callers state what they want: once `hold` or `disarm` has
returned, no frame that was due before is written.
"""

import errno
import os
import select
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, TimeoutError
from contextlib import closing, suppress
from typing import Final, TypeVar

import serial

from atpid_common.real_time import as_main_thread
from atpid_driver import DriverError, NotReadyError
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.dialogue import CONFIRM_TIME, Dialogue
from atpid_driver.motor.faults import LinkError, StopNotConfirmedError
from atpid_driver.motor.protocol import IdentityReply
from atpid_driver.motor.session import SessionLostError
from atpid_driver.motor.settings import MotorSettings

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


_FIRST_WAIT, _LONGEST_WAIT = 0.1, 5.0
#: How long arming may take until the board has accepted both words [s].
_ARM_TIME: Final = 2.5
_T = TypeVar("_T")


class Link:
    """Owns port and thread. Any thread may call it; what it takes is written by the I/O thread."""

    def __init__(self, settings: MotorSettings) -> None:
        self._settings = settings
        self._dialogue = Dialogue(settings)
        self._lock = threading.Lock()
        self._closing, self._ended = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._port: SerialPort | None = None
        self._first: Future[IdentityReply] = Future()
        self.reports = self._dialogue.reports

    @property
    def reading(self) -> Reading:
        """The last state the board reported."""
        return self._dialogue.reading

    @property
    def heartbeat(self) -> bool:
        """Whether the motor is armed, or being armed, as far as this side is concerned."""
        return self._dialogue.heartbeat

    def start(self) -> IdentityReply:
        """Start the thread and return the identity. Raises what the first attempt raised; the thread has then ended."""
        self._closing.clear()
        self._ended.clear()
        self._first = Future()
        self._thread = threading.Thread(target=self._run, name="ceiling motor link", daemon=True)
        self._thread.start()
        try:
            return self._first.result()
        except DriverError:
            self.stop()
            self.reports()  # the caller gets the error itself
            raise

    def stop(self) -> None:
        """End the thread; it disarms first if it can."""
        if self._thread is not None:
            with self._lock:
                self._dialogue.disarm(time.monotonic())
                self._closing.set()
                self._wake()
            self._ended.wait()  # an interrupted join takes a running thread for an ended one: the motor would stay on
            self._thread.join()
        self._thread = None
        self._dialogue.closed()

    def keep_alive(self) -> None:
        """Note that the caller still runs: heartbeats go on for `KEEP_ALIVE_TIME`."""
        self._dialogue.keep_alive(time.monotonic())

    def hold(self, sequence: int) -> None:
        """Stop the ceiling where it is; what becomes of it is reported."""
        self._state(lambda now: self._dialogue.hold(sequence, now))

    def move(self, target: int, sequence: int) -> None:
        """Travel to `target` [µm], after a stop that is not confirmed yet."""
        self._state(lambda now: self._dialogue.move(target, sequence, now))

    def arm(self) -> None:
        """Arm, and home if the reference is lost. Raises `DriverError` where the board does not accept it."""
        done = self._state(self._dialogue.arm)
        try:
            done.result(timeout=_ARM_TIME)
        except TimeoutError:
            with self._lock:
                self._dialogue.end_arming(NotReadyError("arming took too long"))
            raise LinkError(f"the board did not accept ARM within {_ARM_TIME:g} s") from None

    def disarm(self) -> None:
        """Switch the motor off. Raises `StopNotConfirmedError` where the board does not confirm it in time."""
        if self._thread is None:
            return
        confirmed = self._state(self._dialogue.disarm)
        try:
            confirmed.result(timeout=CONFIRM_TIME)
        except TimeoutError:
            connected = "it does not answer" if self._dialogue.identified else "there is no connection to it"
            raise StopNotConfirmedError(
                f"motor off not confirmed by the board: {connected}; its firmware switches off 0.5 s after the last "
                "heartbeat: use the emergency stop where the ceiling moves on"
            ) from None

    def health(self) -> dict[str, str]:
        """Return identity and counters for diagnostics."""
        board, name = self._dialogue.identity, ""
        if board is not None:
            name = f"{self._settings.port}: {board.name} {board.version}, boot {board.boots} ({board.reset_cause})"
        return {"hardware_id": name, "last error": self._dialogue.last_error} | self._dialogue.counts()

    def _state(self, want: Callable[[float], _T]) -> _T:
        with self._lock:
            result = want(time.monotonic())
            self._wake()
        return result

    def _wake(self) -> None:
        if self._port is not None:
            self._port.wake()

    # -- the thread ------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        as_main_thread()  # a stop waits for it
        try:
            self._keep_connected()
        finally:
            self._ended.set()

    def _keep_connected(self) -> None:
        wait = _FIRST_WAIT
        while not self._closing.is_set():
            before = self._dialogue.identity
            try:
                with closing(SerialPort(self._settings.port, self._settings.baud)) as port:
                    self._serve(port)
            except DriverError as error:
                self._failed(error)
            except Exception as error:  # noqa: BLE001  # an exception would end the thread without a report
                self._failed(LinkError(f"link to the board failed: {type(error).__name__}: {error}"))
            wait = _FIRST_WAIT if self._dialogue.identity is not before else min(2 * wait, _LONGEST_WAIT)
            self._closing.wait(wait)

    def _failed(self, error: DriverError) -> None:
        with self._lock:
            self._dialogue.lost(error)
        if not self._first.done():
            self._first.set_exception(error)

    def _serve(self, port: SerialPort) -> None:
        with self._lock:
            self._port = port
            self._dialogue.opened(time.monotonic())
        try:
            while not self._closing.is_set():
                self._turn(port)
            end = time.monotonic() + CONFIRM_TIME
            while self._dialogue.identified and self._dialogue.stopping and time.monotonic() < end:
                self._turn(port)
        finally:
            with self._lock:
                self._port = None  # before it is closed

    def _turn(self, port: SerialPort) -> None:
        """Write what is due, then read until something is due, or a caller wakes the thread.

        All that has come is read before anything is judged to be missing: this thread may have been held up.
        """
        with self._lock:
            frame = self._dialogue.due(time.monotonic())
            if frame is not None:
                port.write(frame)
            wait = self._dialogue.wait(time.monotonic())
        while line := port.read_line(wait):
            wait = 0.0
            with self._lock:
                try:
                    self._dialogue.read(line, time.monotonic())
                except SessionLostError as error:
                    self._dialogue.lost(error)
                    self._dialogue.opened(time.monotonic())
        if not self._first.done() and self._dialogue.ready:
            assert self._dialogue.identity is not None
            self._first.set_result(self._dialogue.identity)
