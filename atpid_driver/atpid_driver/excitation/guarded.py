# SPDX-License-Identifier: Apache-2.0
"""An output in a process of its own, which switches it off where this one is killed or hangs.

Where that process is killed instead, this one opens the device and switches it off. Where both are, the device's own
watchdog does.
"""

import json
import os
import select
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import DriverError
from atpid_driver.excitation.drive import Output
from atpid_driver.excitation.errors import NotReadyError, OutputLostError
from atpid_driver.excitation.outlet_process import OUTLETS
from atpid_driver.excitation.outlets import calibration_of, check_command
from atpid_driver.excitation.settings import ExcitationSettings
from atpid_driver.excitation.signals import Command, Point, unit_signal

#: Until the device has been opened, and until it has confirmed a stop beyond the ramp [s].
_OPEN, _CONFIRM = 15.0, 0.5


class GuardedDrive:
    """The `ExcitationDrive` of a real output."""

    def __init__(self, settings: ExcitationSettings, folder: Path) -> None:
        """Begin unconnected; folder: of calibration files. Raises CalibrationError."""
        calibration_of(settings, folder)
        self._settings, self._folder = settings, folder
        self._process: subprocess.Popen[bytes] | None = None
        self._enabled = False
        self._rest = b""
        self._output = Output(ExciterMode.UNCONFIGURED)

    def connect(self, now: int) -> str:
        """See ExcitationDrive."""
        self.close()
        values = {name: value for name, value in asdict(self._settings).items() if name != "limits"}
        command = [sys.executable, "-m", "atpid_driver.excitation.outlet_process", json.dumps(values), str(self._folder)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self._rest = b""
        self._output = Output(ExciterMode.OFF)
        return str(self._wait("identity", _OPEN))

    def enable(self, now: int) -> None:
        """See ExcitationDrive."""
        self._enabled = True

    def follow(self, command: Command, now: int) -> None:
        """See ExcitationDrive."""
        if not self._enabled:
            raise NotReadyError("the output is off: activate the excitation node")
        self._settings.limits.check(command)
        check_command(self._settings, command)
        if command.kind in (ExciterKind.RANDOM, ExciterKind.RECORDED):
            unit_signal(command, self._settings.sample_rate)  # refused here, where the sender learns of it
        self._send({"command": asdict(command)})

    def correct(self, amplitude: float, frequency: float, *, waits: bool) -> None:
        """See ExcitationDrive."""
        held = 1.0 if self._settings.backend == "labjack_dac" else amplitude  # a disc's amplitude is what it is
        self._send({"factors": [held, frequency], "waits": waits})

    def turn(self, now: int) -> Output:
        """See ExcitationDrive: the last state that was received, and a request for the next."""
        if self._process is not None:
            self._send({})
            for found in self._received(0.0):
                self._take(found)
        return self._output

    def stop(self, now: int) -> None:
        """See ExcitationDrive."""
        self._send({"stop": True})

    def off(self, now: int) -> None:
        """See ExcitationDrive."""
        self._enabled = False
        if self._process is None:
            return
        self._send({"off": True})
        self._wait("off", self._settings.stop_time + _CONFIRM)
        self._output = Output(ExciterMode.OFF)

    def close(self) -> None:
        """See ExcitationDrive."""
        process, self._process = self._process, None
        self._enabled, self._output = False, Output(ExciterMode.UNCONFIGURED)
        if process is None:
            return
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
        try:
            process.wait(self._settings.stop_time + 2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            self._rescue()

    def _send(self, message: dict[str, Any]) -> None:
        if self._process is None or self._process.stdin is None:
            return
        try:
            os.write(self._process.stdin.fileno(), json.dumps(message).encode() + b"\n")
        except BrokenPipeError:
            self._lose("its process has ended")

    def _received(self, seconds: float) -> list[dict[str, Any]]:
        """Return the answers that have come, waiting for `seconds` [s] for the first."""
        assert self._process is not None
        assert self._process.stdout is not None
        stream = self._process.stdout.fileno()
        if not select.select([stream], [], [], seconds)[0]:
            return []
        read = os.read(stream, 65536)
        *lines, self._rest = (self._rest + read).split(b"\n")
        found = [json.loads(line) for line in lines]
        if not read and not found:
            self._lose("its process has ended")
        return found

    def _wait(self, key: str, seconds: float) -> Any:
        """Return the answer with `key`, within `seconds` [s]."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            for found in self._received(left):
                if key in found:
                    return found[key]
                self._take(found)
        self._lose("it does not answer")
        return None

    def _take(self, found: dict[str, Any]) -> None:
        if "error" in found:
            self._lose(found["error"])
        if "mode" in found:
            self._output = Output(
                ExciterMode(found["mode"]), ExciterKind(found["kind"]), found["sequence"], found["amplitude"],
                found["frequency"], Point(*found["wanted"]), found["volts"],
            )  # fmt: skip

    def _lose(self, reason: str) -> None:
        """End the process, switch the output off from here, and raise OutputLostError."""
        process, self._process = self._process, None
        self._enabled, self._output = False, Output(ExciterMode.FAULT)
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()
        raise OutputLostError(f"output of {self._settings.terminal}: {reason}; {self._rescue()}")

    def _rescue(self) -> str:
        """Switch the output off from this process; return in words whether it is."""
        outlet = OUTLETS[self._settings.backend](self._settings, calibration_of(self._settings, self._folder))
        try:
            outlet.open()
            outlet.close()
        except DriverError as error:
            return f"off not confirmed ({error}); the device's watchdog acts after {self._settings.watchdog} s"
        return "switched off"
