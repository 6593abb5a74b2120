# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The serial backend: the real board, or the emulated one, as a `CeilingActuator`.

Callers read the last reading and state what they want; one I/O thread (`link.py`) communicates with the board.
The heartbeat continues only while the reading is read: the firmware switches the motor off where a node hangs.
Only `activate` arms: after any fault or interruption heights are refused until a person has called it again.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import isnan, nan

from atpid_common.injected_faults import Injected
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, NotReadyError, SettingsError
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.faults import StopNotConfirmedError, in_words
from atpid_driver.motor.link import Link
from atpid_driver.motor.protocol import micrometres
from atpid_driver.motor.settings import MotorSettings


class SerialActuator:
    """A ceiling behind a serial port."""

    placed, true_height = True, nan  # it homes; and nothing but its readings shows where it stands

    def __init__(self, settings: MotorSettings) -> None:
        self.limits = settings.limits  # which lie inside the firmware's
        self._link = Link(settings)
        self.reports, self.health = self._link.reports, self._link.health

    def place(self, height: float, now: int) -> None:
        """Raise `NotReadyError`: a real ceiling stands where it stands."""
        raise NotReadyError("a real ceiling cannot be placed: activate it, so that it homes")

    def with_faults(self, faults: Sequence[Injected], now: int) -> "SerialActuator":
        """Return itself; raise `SettingsError` for any fault."""
        if faults:
            raise SettingsError("faults: given some with backend serial; allowed: none, a real motor is not disturbed")
        return self

    def connect(self, now: int) -> str:
        """Open the port and request the identity until the board answers; the link then reconnects by itself."""
        identity = self._link.start()
        return f"{identity.name} {identity.version}"

    def activate(self, now: int) -> None:
        """Arm, clearing faults whose cause is gone, and start homing if the reference is lost."""
        try:
            self._link.arm()
        except DriverError:
            with suppress(StopNotConfirmedError):
                self._link.disarm()
            raise

    def deactivate(self, now: int) -> None:
        """Stop and disarm: motor off. Raises `StopNotConfirmedError` where the board does not confirm it."""
        self._link.disarm()

    def move(self, height: float, sequence: int, now: int) -> None:
        """Travel to `height` [m], sent to the board within `command_timeout`; NaN: stop."""
        self._link.keep_alive()
        goal = height if isnan(height) else self.limits.check(height)
        reading = self._link.reading
        if not (reading.ready and self._link.heartbeat):
            raise NotReadyError(f"ceiling height {goal:g} m not taken up: {self._state_text(reading)}")
        if isnan(goal):
            self._link.hold(sequence)
        else:
            self._link.move(micrometres(goal), sequence)

    def read(self, now: int) -> Reading:
        """Return the last state the board reported; this keeps the heartbeat alive."""
        self._link.keep_alive()
        return self._link.reading

    def observe(self, now: int) -> Reading:
        """Return the last state the board reported; the heartbeat ends unless `read` is called as well."""
        return self._link.reading

    def close(self) -> None:
        """Disarm if the board still answers, and release the port."""
        self._link.stop()

    def _state_text(self, reading: Reading) -> str:
        """Return why no height can be taken up, and what to do."""
        if reading.mode is Mode.UNCONFIGURED:
            return "no connection to the board; it is looked for"
        if reading.mode is Mode.HOMING:
            return "homing; command it again when it is done"
        if not self._link.heartbeat:
            return "motor off; activate it"
        return f"{in_words(reading.faults) or 'motor off, or not homed'}; remove the cause, then call ~/rearm"
