# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver.excitation.outlet_process`: owns one analogue output, and switches it off by itself.

It reads one JSON object a line from standard input and answers with its state on standard output. When its partner is
silent, or its input ends because the partner is gone, it ramps down: no output survives the node. It ignores Ctrl-C and
SIGTERM, which the node receives too.
"""

import json
import math
import os
import select
import signal
import sys
import time
from pathlib import Path
from typing import Any

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import DriverError
from atpid_driver.excitation.outlets import Outlet, T7Level, T7Stream, calibration_of
from atpid_driver.excitation.settings import ExcitationSettings
from atpid_driver.excitation.signals import Command, Generator

#: Between two turns; silence of the partner, whose states come every 50 ms, after which the output ramps down [s].
PERIOD, SILENCE = 0.01, 0.25
OUTLETS: dict[str, type[T7Level] | type[T7Stream]] = {"labjack_dac": T7Level, "labjack_stream": T7Stream}


class Process:
    """Reads requests, moves the output on, and answers."""

    def __init__(self, settings: ExcitationSettings, folder: Path) -> None:
        """Make the outlet, unopened. Raises DriverError."""
        self._outlet: Outlet = OUTLETS[settings.backend](settings, calibration_of(settings, folder))
        self._generator = Generator(settings.limits, settings.sample_rate)
        self._settings = settings
        self._heard = time.monotonic()
        self._ended = self._reported = False
        self._rest = b""
        self._put = (0.0, 0.0, 0.0)

    def run(self) -> None:
        """Open the device, and run until the input has ended and the output is off. Raises DriverError."""
        self._answer({"identity": self._outlet.open()})
        try:
            due = time.monotonic()
            while not self._ended:
                due = max(due + PERIOD, time.monotonic() - PERIOD)
                while (left := due - time.monotonic()) > 0.0 and not self._ended:
                    if select.select([0], [], [], left)[0]:
                        self._read()
                time.sleep(max(0.0, due - time.monotonic()))
                self._turn()
            self._ramp_down()
        finally:
            self._outlet.close()

    def _turn(self) -> None:
        now = time.monotonic()
        if now - self._heard > SILENCE:
            self._generator.stop()
        self._put = self._outlet.put(self._generator, now)

    def _ramp_down(self) -> None:
        """Return when the output is off."""
        self._generator.stop()
        end = math.inf
        while time.monotonic() < end:
            self._turn()
            if math.isinf(end) and self._generator.mode is ExciterMode.OFF:
                end = time.monotonic() + self._outlet.lead
            time.sleep(PERIOD)
        self._outlet.rest()

    def _read(self) -> None:
        received = os.read(0, 65536)
        self._ended = not received
        *lines, self._rest = (self._rest + received).split(b"\n")
        for line in lines:
            self._heard = time.monotonic()
            self._act(json.loads(line))

    def _act(self, request: dict[str, Any]) -> None:
        generator = self._generator
        if "command" in request:
            values = request["command"]
            try:
                generator.follow(Command(**values | {"kind": ExciterKind(values["kind"])}))
            except DriverError as error:
                self._answer({"refused": str(error)})
        elif "factors" in request:
            generator.factors, generator.waits = tuple(request["factors"]), request["waits"]
        elif "stop" in request:
            generator.stop()
        elif "off" in request:
            self._ramp_down()
            self._answer({"off": True})
        else:
            self._answer(self._state())

    def _state(self) -> dict[str, Any]:
        generator = self._generator
        amplitude, frequency, volts = self._put
        return {"mode": int(generator.mode), "kind": int(generator.command.kind),
                "sequence": generator.command.sequence, "amplitude": amplitude, "frequency": frequency,
                "wanted": generator.wanted, "volts": volts}  # fmt: skip

    def _answer(self, message: dict[str, Any]) -> None:
        try:
            os.write(1, json.dumps(message).encode() + b"\n")
        except BrokenPipeError:
            self._ended = True


def main() -> int:
    """Run with the settings of the command line; return the exit status, with one line on standard output before."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    try:
        Process(ExcitationSettings(**json.loads(sys.argv[1])), Path(sys.argv[2])).run()
    except DriverError as error:
        os.write(1, json.dumps({"error": str(error)}).encode() + b"\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
