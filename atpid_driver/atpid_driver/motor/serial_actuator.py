# SPDX-License-Identifier: Apache-2.0
"""The serial backend: the real board, or the emulated one, as a `CeilingActuator`.

Callers read the last reading and queue jobs; one I/O thread (`link.py`) communicates with the board.
The heartbeat continues only while the reading is read: the firmware switches the motor off where a node hangs.
"""

from concurrent.futures import TimeoutError
from contextlib import suppress
from math import isfinite, isnan

from atpid_driver.motor.ceiling_actuator import Identity, Mode, Reading
from atpid_driver.motor.errors import LinkError, MotorError, NotReadyError
from atpid_driver.motor.faults import LINK_FAULTS, in_words
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
        self._recovery: Job | None = None

    def connect(self, now: int) -> Identity:
        """Open the port and request the identity until the board answers; the link then reconnects by itself."""
        identity = self._link.start()
        return Identity(identity.name, identity.version)

    def activate(self, now: int) -> None:
        """Arm, clearing faults whose cause is gone, and start homing if the reference is lost."""
        self._link.keep_alive()
        self._link.heartbeat = True
        try:
            self._do(self._arming())
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
            self._recover(reading, goal)
        elif isnan(goal):
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

    def close(self) -> None:
        """Disarm if the board still answers, and release the port."""
        self._link.heartbeat = False
        self._link.stop()

    def _arming(self) -> Job:
        return Job((("ARM", ()),) if self._link.reading.homed else (("ARM", ()), ("HOME", ())))

    def _recover(self, reading: Reading, goal: float) -> None:
        """Arm and home again on a fresh height after a lost link; never without a command, never after another fault.

        Commands that come while that is under way do not start it anew: they would fill the queue of a slow board.
        """
        lost = reading.mode is Mode.DISARMED or (reading.mode is Mode.FAULT and not reading.faults & ~LINK_FAULTS)
        under_way = self._recovery is not None and not self._recovery.done.done()
        if self._link.heartbeat and lost and isfinite(goal) and not under_way:
            job = self._arming()
            self._link.submit(job)
            self._recovery = job
        raise NotReadyError(f"ceiling height {goal:g} m not taken up: {self._state_text(reading)}")

    def _state_text(self, reading: Reading) -> str:
        if reading.mode is Mode.UNCONFIGURED:
            return "no connection to the board; it is looked for"
        if reading.mode is Mode.HOMING:
            return "homing; command it again when it is done"
        if reading.faults & ~LINK_FAULTS:
            return f"{in_words(reading.faults)}; remove the cause, then call ~/rearm"
        return "motor off; armed and homed again first" if self._link.heartbeat else "motor off; activate it"

    def _do(self, job: Job) -> None:
        """Queue `job` and wait for its outcome, at most JOB_TIME."""
        job.awaited = True
        self._link.submit(job)
        try:
            job.done.result(timeout=JOB_TIME)
        except TimeoutError:
            raise LinkError(f"the board did not answer {job.commands[0][0]} within {JOB_TIME:g} s") from None
