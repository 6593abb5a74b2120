# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serial backend: the real board, or the emulated one, as a `CeilingActuator`.

Callers read the last reading and state what they want; one I/O thread opens the port, writes what the dialogue has due,
reads, and reconnects with backoff. Each frame is decided on and written under the lock by which callers state what they
want: once a stop has returned, no frame that was due before is written.
The heartbeat continues only while the reading is read: the firmware switches the motor off where a node hangs.
Only `activate` arms: after any fault or interruption heights are refused until a person has called it again.
"""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, TimeoutError
from contextlib import closing, suppress
from math import isnan, nan
from typing import Final, TypeVar

from atpid_common.injected_faults import Injected
from atpid_common.real_time import as_main_thread
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, NotReadyError, SettingsError
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.dialogue import CONFIRM_TIME, Dialogue
from atpid_driver.motor.faults import LinkError, StopNotConfirmedError, in_words
from atpid_driver.motor.protocol import IdentityReply, micrometres
from atpid_driver.motor.serial_port import SerialPort
from atpid_driver.motor.session import SessionLostError
from atpid_driver.motor.settings import MotorSettings

_FIRST_WAIT, _LONGEST_WAIT = 0.1, 5.0
#: How long arming may take until the board has accepted both words [s].
_ARM_TIME: Final = 2.5
_T = TypeVar("_T")


class SerialActuator:
    """A ceiling behind a serial port, called from whatever thread; what it takes is written by the I/O thread."""

    placed, true_height = True, nan  # it homes; and nothing but its readings shows where it stands

    def __init__(self, settings: MotorSettings) -> None:
        self._settings = settings
        self.limits = settings.limits  # which lie inside the firmware's
        self._dialogue = Dialogue(settings)
        self._lock = threading.Lock()
        self._closing, self._ended = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._port: SerialPort | None = None
        self._first: Future[IdentityReply] = Future()
        self.reports = self._dialogue.reports

    def place(self, height: float, now: int) -> None:
        """Raise `NotReadyError`: a real ceiling stands where it stands."""
        raise NotReadyError("a real ceiling cannot be placed: activate it, so that it homes")

    def with_faults(self, faults: Sequence[Injected], now: int) -> "SerialActuator":
        """Return itself; raise `SettingsError` for any fault."""
        if faults:
            raise SettingsError("faults: given some with backend serial; allowed: none, a real motor is not disturbed")
        return self

    def connect(self, now: int) -> str:
        """Open the port and request the identity until the board answers; it is then reconnected by itself.

        Raises what the first attempt raised; the thread has then ended.
        """
        self._closing.clear()
        self._ended.clear()
        self._first = Future()
        self._thread = threading.Thread(target=self._run, name="ceiling motor link", daemon=True)
        self._thread.start()
        try:
            identity = self._first.result()
        except DriverError:
            self.close()
            self.reports()  # the caller gets the error itself
            raise
        return f"{identity.name} {identity.version}"

    def activate(self, now: int) -> None:
        """Arm, clearing faults whose cause is gone, and start homing if the reference is lost."""
        try:
            self._arm()
        except DriverError:
            with suppress(StopNotConfirmedError):
                self.deactivate(now)
            raise

    def _arm(self) -> None:
        done = self._want(self._dialogue.arm)
        try:
            done.result(timeout=_ARM_TIME)
        except TimeoutError:
            with self._lock:
                self._dialogue.end_arming(NotReadyError("arming took too long"))
            raise LinkError(f"the board did not accept ARM within {_ARM_TIME:g} s") from None

    def deactivate(self, now: int) -> None:
        """Stop and disarm: motor off. Raises `StopNotConfirmedError` where the board does not confirm it in time."""
        if self._thread is None:
            return
        confirmed = self._want(self._dialogue.disarm)
        try:
            confirmed.result(timeout=CONFIRM_TIME)
        except TimeoutError:
            connected = "it does not answer" if self._dialogue.identified else "there is no connection to it"
            raise StopNotConfirmedError(
                f"motor off not confirmed by the board: {connected}; its firmware switches off 0.5 s after the last "
                "heartbeat: use the emergency stop where the ceiling moves on"
            ) from None

    def move(self, height: float, sequence: int, now: int) -> None:
        """Travel to `height` [m], sent to the board within `command_timeout`; NaN: stop."""
        self._dialogue.keep_alive(time.monotonic())
        goal = height if isnan(height) else self.limits.check(height)
        reading = self._dialogue.reading
        if not (reading.ready and self._dialogue.heartbeat):
            raise NotReadyError(f"ceiling height {goal:g} m not taken up: {self._state_text(reading)}")
        if isnan(goal):
            self._want(lambda at: self._dialogue.hold(sequence, at))
        else:
            self._want(lambda at: self._dialogue.move(micrometres(goal), sequence, at))

    def read(self, now: int) -> Reading:
        """Return the last state the board reported; this keeps the heartbeat alive."""
        self._dialogue.keep_alive(time.monotonic())
        return self._dialogue.reading

    def observe(self, now: int) -> Reading:
        """Return the last state the board reported; the heartbeat ends unless `read` is called as well."""
        return self._dialogue.reading

    def health(self) -> dict[str, str]:
        """Return identity and counters for diagnostics."""
        board, name = self._dialogue.identity, ""
        if board is not None:
            name = f"{self._settings.port}: {board.name} {board.version}, boot {board.boots} ({board.reset_cause})"
        return {"hardware_id": name, "last error": self._dialogue.last_error} | self._dialogue.counts()

    def close(self) -> None:
        """End the thread, which disarms first if the board still answers, and release the port."""
        if self._thread is not None:
            with self._lock:
                self._dialogue.disarm(time.monotonic())
                self._closing.set()
                self._wake()
            self._ended.wait()  # an interrupted join takes a running thread for an ended one: the motor would stay on
            self._thread.join()
        self._thread = None
        self._dialogue.closed()

    def _state_text(self, reading: Reading) -> str:
        """Return why no height can be taken up, and what to do."""
        if reading.mode is Mode.UNCONFIGURED:
            return "no connection to the board; it is looked for"
        if reading.mode is Mode.HOMING:
            return "homing; command it again when it is done"
        if not self._dialogue.heartbeat:
            return "motor off; activate it"
        return f"{in_words(reading.faults) or 'motor off, or not homed'}; remove the cause, then call ~/rearm"

    def _want(self, want: Callable[[float], _T]) -> _T:
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
