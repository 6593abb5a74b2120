# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_exciter.excitation.outlet_process FD`: owns one analogue output, and switches it off by itself.

It reads requests (name, arguments) from a connection of `multiprocessing` and answers with (name, value). When its
partner is silent it ramps down, and follows nothing until it was switched off. When the connection ends because the
partner is gone it ramps down and ends: no output survives the node. It ignores Ctrl-C and SIGTERM, which the node
receives too.
"""

import math
import signal
import sys
import time
from multiprocessing.connection import Connection

from atpid_common.vocabulary import ExciterMode
from atpid_driver import DriverError
from atpid_driver.calibration.model import Calibration
from atpid_exciter.excitation.drive import Output
from atpid_exciter.excitation.outlets import OUTLETS, load_library
from atpid_exciter.excitation.settings import ExcitationSettings
from atpid_exciter.excitation.signals import Generator

#: Between two turns; silence of the partner, whose requests come every 50 ms, after which the output ramps down [s].
PERIOD, SILENCE = 0.01, 0.25


class Process:
    """Reads requests, moves the output on, and answers."""

    def __init__(self, partner: Connection, settings: ExcitationSettings, calibration: Calibration) -> None:
        """Begin unopened."""
        self._partner, self._settings = partner, settings
        self._outlet = OUTLETS[settings.backend](settings, calibration)
        self._generator = Generator(settings)
        self._received = time.monotonic()
        self._ended = False
        self._output = Output(ExciterMode.OFF)

    def run(self) -> None:
        """Open the device on request, and run until the connection has ended and the output is off.

        Raises DriverError, and EOFError where the connection ends before.
        """
        try:
            load_library(self._settings)  # which takes long on a busy machine, and shows nothing about the device
            self._answer("started")
            self._partner.recv()  # until it is to be opened
            self._answer("identity", self._outlet.open())
            due = time.monotonic()
            while not self._ended:
                due = max(due + PERIOD, time.monotonic())
                while not self._ended and self._partner.poll(max(0.0, due - time.monotonic())):
                    self._read()
                self._turn()
            self._ramp_down()
        finally:
            self._outlet.close()

    def _turn(self) -> None:
        now = time.monotonic()
        if now - self._received > SILENCE:
            self._generator.end(f"no sign of the node for {SILENCE:g} s")
        self._output = self._outlet.put(self._generator, now)

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
        try:
            name, arguments = self._partner.recv()
        except (EOFError, OSError):
            self._ended = True
            return
        self._received = time.monotonic()
        if name == "state":
            self._answer(name, self._output)
        elif name == "off":
            self._ramp_down()
            self._generator.cut()
            self._answer(name)
        else:
            getattr(self._generator, name)(*arguments)

    def _answer(self, name: str, value: object = None) -> None:
        try:
            self._partner.send((name, value))
        except OSError:
            self._ended = True


def main() -> int:
    """Run on the connection whose number the command line has; return the exit status, an error answered before."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    partner = Connection(int(sys.argv[1]))
    try:
        Process(partner, *partner.recv()).run()
    except EOFError:  # the node has ended before
        return 0
    except DriverError as error:
        partner.send(("error", str(error)))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
