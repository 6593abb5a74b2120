# SPDX-License-Identifier: Apache-2.0
"""The serial backend: the real board, or the emulated one, as a `CeilingActuator`.

Callers read the last reading and queue jobs; one I/O thread (`link.py`) communicates with the board.
The heartbeat continues only while the reading is read: the firmware switches the motor off where a node hangs.
Only `activate` arms: after any fault or interruption heights are refused until a person has called it again.
"""

from collections.abc import Sequence
from concurrent.futures import TimeoutError
from contextlib import suppress
from math import isnan

from atpid_common.injected_faults import Injected
from atpid_driver.motor.ceiling_actuator import Identity, Mode, Reading
from atpid_driver.motor.errors import LinkError, MotorError, NotReadyError
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.link import Job, Link
from atpid_driver.motor.protocol import micrometres
from atpid_driver.motor.settings import MotorSettings

JOB_TIME = 2.5


class SerialActuator:
    """A ceiling behind a serial port."""

    def __init__(self, settings: MotorSettings) -> None:
        self.limits = settings.limits  # which lie inside the firmware's
        self._link = Link(settings)
        self.reports, self.health = self._link.reports, self._link.health

    def inject(self, faults: Sequence[Injected]) -> None:
        """Act faults of the link from now on, and no others; their times are those of the steady clock."""
        self._link.injected = tuple(faults)

    def connect(self, now: int) -> Identity:
        """Open the port and request the identity until the board answers; the link then reconnects by itself."""
        identity = self._link.start()
        return Identity(identity.name, identity.version)

    def activate(self, now: int) -> None:
        """Arm, clearing faults whose cause is gone, and start homing if the reference is lost."""
        self._link.keep_alive()
        self._link.heartbeat = True
        try:
            self._do(Job((("ARM", ()),) if self._link.reading.homed else (("ARM", ()), ("HOME", ()))))
        except MotorError:
            self._link.heartbeat = False
            raise

    def deactivate(self, now: int) -> None:
        """Stop and disarm: motor off. Where the link fails the firmware does so by itself within 500 ms."""
        self._link.heartbeat = False
        with suppress(LinkError):
            self._do(Job((("DISARM", ()),)))

    def move(self, height: float, sequence: int, now: int) -> None:
        """Queue `height` [m] for the I/O thread, which sends it within `command_timeout`; NaN: stop."""
        self._link.keep_alive()
        goal = height if isnan(height) else self.limits.check(height)
        reading = self._link.reading
        if not reading.ready:
            raise NotReadyError(f"ceiling height {goal:g} m not taken up: {self._state_text(reading)}")
        if isnan(goal):
            self._link.goal = None
            if reading.mode is Mode.MOVING:
                self._link.submit(Job((("STOP", ()),), sequence))
        elif micrometres(goal) != self._link.goal:
            self._link.goal = micrometres(goal)
            self._link.submit(Job((("MOVE", (micrometres(goal),)),), sequence))

    def read(self, now: int) -> Reading:
        """Return the last state the board reported; this keeps the heartbeat alive."""
        self._link.keep_alive()
        return self._link.reading

    def observe(self, now: int) -> Reading:
        """Return the last state the board reported; the heartbeat ends unless `read` is called as well."""
        return self._link.reading

    def close(self) -> None:
        """Disarm if the board still answers, and release the port."""
        self._link.heartbeat = False
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

    def _do(self, job: Job) -> None:
        """Queue `job` and wait for its outcome, at most JOB_TIME."""
        job.awaited = True
        self._link.submit(job)
        try:
            job.done.result(timeout=JOB_TIME)
        except TimeoutError:
            raise LinkError(f"the board did not answer {job.commands[0][0]} within {JOB_TIME:g} s") from None
