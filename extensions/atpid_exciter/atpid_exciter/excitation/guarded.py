# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""An output in a process of its own, which switches it off where this one is killed or hangs.

Where that process is killed or hangs instead, this one opens the device and switches it off. Where both are, the
device's own watchdog does.
"""

import os
import socket
import struct
import subprocess
import sys
import time
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from atpid_common.vocabulary import ExciterMode
from atpid_driver import DriverError
from atpid_exciter.excitation.drive import ExcitationDrive, Output, OutputLostError
from atpid_exciter.excitation.outlets import OUTLETS, calibration_of, load_library
from atpid_exciter.excitation.settings import Command, ExcitationSettings

#: Until its process runs, which a busy machine may delay for long, and until the device has been opened then [s].
_START, _OPEN = 120.0, 15.0
#: Until it has answered a request, which it may not have taken yet, and has confirmed a stop beyond the ramp [s].
_ANSWER, _CONFIRM = 0.25, 0.5
#: One that may have been late only because of this node has so long to take a request [s].
_LEAST = 0.02
#: For so long it is tried again to switch off a device that does not answer, and so often: it may be back at once [s].
_RESCUE, _AGAIN = 0.3, 0.05


class GuardedDrive(ExcitationDrive):
    """The `ExcitationDrive` of a real output."""

    def __init__(self, settings: ExcitationSettings, folder: Path) -> None:
        """Begin unconnected; folder: of calibration files. Raises CalibrationError."""
        super().__init__(settings)
        self._calibration = calibration_of(settings, folder)
        self._process: subprocess.Popen[bytes] | None = None
        self._partner: Connection | None = None
        self._spare: tuple[subprocess.Popen[bytes], Connection] | None = None  # that has opened nothing
        self._asked: float | None = None  # steady time of the first request for a state that is not answered [s]
        self._output = Output(ExciterMode.UNCONFIGURED)

    def connect(self) -> str:
        """See ExcitationDrive."""
        spare, self._spare = self._spare, None
        self.close()
        self._process, self._partner = spare or self._started()
        self._output, self._asked = Output(ExciterMode.OFF), None
        self._wait("started", _START)
        with suppress(OSError):  # the node's own priority, which a process that it starts has not
            os.sched_setscheduler(self._process.pid, os.sched_getscheduler(0), os.sched_getparam(0))
        self._send("open")
        return str(self._wait("identity", _OPEN))

    def _started(self) -> tuple[subprocess.Popen[bytes], Connection]:
        """Start a process of the output, which opens its device on request: its libraries take a second to load."""
        load_library(self._settings)  # `_rescue` must not wait for it
        ours, theirs = Pipe()
        program = [sys.executable, "-m", "atpid_exciter.excitation.outlet_process", str(theirs.fileno())]
        with theirs:
            process = subprocess.Popen(program, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()])
        with suppress(OSError):  # it has ended, which the missing answer shows
            ours.send((self._settings, self._calibration))
        return process, ours

    def turn(self, _now: int, /) -> Output:
        """See ExcitationDrive: the last state that was received, and a request for the next."""
        self._read()
        if self._asked is not None and time.monotonic() - self._asked > _ANSWER:
            raise self._lost("it does not answer")
        self._ask()
        return self._output

    def follow(self, command: Command) -> None:
        """See ExcitationDrive. It is asked before for its state: to make a signal takes time in which it may hang."""
        self._ask()
        super().follow(command)

    def _ask(self) -> None:
        if self._partner is not None:
            self._asked = self._asked or time.monotonic()
            self._act("state")

    def off(self) -> None:
        """See ExcitationDrive."""
        self._enabled = False
        if self._partner is not None:
            self._act("off")
            self._wait("off", self._settings.stop_time + _CONFIRM)
            self._output = Output(ExciterMode.OFF)

    def close(self) -> None:
        """See ExcitationDrive."""
        if self._spare is not None:
            spare, partner = self._spare
            self._spare = None
            partner.close()
            spare.kill()  # it has opened nothing
            spare.wait()
        process = self._release(ExciterMode.UNCONFIGURED)
        if process is None:
            return
        try:
            process.wait(self._settings.stop_time + 2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            self._rescue()

    def _act(self, method: str, *arguments: object) -> None:
        self._send((method, arguments))

    def _send(self, request: object) -> None:
        self._read()
        if self._partner is None:
            return
        asked = time.monotonic() if self._asked is None else self._asked
        try:
            left = asked + _ANSWER - time.monotonic()
            _limit_sending(self._partner, max(_LEAST, 0.5 * left))  # what is taken in part is waited for twice
            self._partner.send(request)
        except BlockingIOError:
            raise self._lost("it takes no request") from None
        except OSError:
            raise self._lost("its process has ended") from None

    def _read(self) -> None:
        """Take the answers that have come."""
        while self._partner is not None and self._partner.poll():
            self._receive()

    def _receive(self) -> tuple[str, object]:
        """Return the next answer; a state is kept. Raises OutputLostError."""
        assert self._partner is not None
        try:
            name, value = self._partner.recv()
        except (EOFError, OSError):
            raise self._lost("its process has ended") from None
        if name == "error":
            raise self._lost(value)
        if name == "state":
            self._output, self._asked = value, None
        return name, value

    def _wait(self, name: str, seconds: float) -> object:
        """Return the answer of that name, within `seconds` [s]. Raises OutputLostError."""
        end = time.monotonic() + seconds
        while self._partner is not None and self._partner.poll(max(0.0, end - time.monotonic())):
            found, value = self._receive()
            if found == name:
                self._asked = None
                return value
        raise self._lost("it does not answer")

    def _release(self, mode: ExciterMode) -> subprocess.Popen[bytes] | None:
        """Close the connection, at which the process ends by itself, and return the process."""
        process, partner, self._process, self._partner = self._process, self._partner, None, None
        self._enabled, self._asked, self._output = False, None, Output(mode)
        if partner is not None:
            partner.close()
        return process

    def _lost(self, reason: str) -> OutputLostError:
        """End the process, switch the output off from here, and return the error."""
        process = self._release(ExciterMode.FAULT)
        if process is not None:
            process.kill()
            process.wait()
        error = OutputLostError(f"output of {self._settings.terminal}: {reason}; {self._rescue()}")
        with suppress(OSError):  # there are no more processes to be had, of which arming will complain
            self._spare = self._spare or self._started()  # so that it is armed at once when a person asks for it
        return error

    def _rescue(self) -> str:
        """Switch the output off from this process; return in words whether it is."""
        end, problem = time.monotonic() + _RESCUE, ""
        while not problem or time.monotonic() < end:
            outlet = OUTLETS[self._settings.backend](self._settings, self._calibration)
            try:
                outlet.open()
                outlet.close()
            except DriverError as error:
                problem = str(error)
                time.sleep(_AGAIN)
            else:
                return "switched off"
        own = self._settings.backend != "nidaqmx"
        then = f"the T7's watchdog acts after {self._settings.watchdog} s" if own else "cut the amplifier's supply"
        return f"off not confirmed ({problem}); {then}"


def _limit_sending(partner: Connection, seconds: float) -> None:
    """Let what is sent fail with BlockingIOError where the partner does not read for `seconds` [s]."""
    limit = struct.pack("ll", *divmod(round(1e6 * seconds), 1_000_000))
    with socket.socket(fileno=partner.fileno()) as ours:
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        ours.detach()
