# SPDX-License-Identifier: Apache-2.0
"""The serial backend: the real board, or the emulated one, behind the role `CeilingActuator`.

Callers only look at the last reading and hand in jobs; one I/O thread (`link.py`) talks to the board.
The heartbeat goes on only while somebody reads: a node that hangs lets the firmware switch the motor off.
"""

from __future__ import annotations

from concurrent.futures import TimeoutError
from contextlib import suppress
from math import isfinite, isnan

from atpid_driver.motor.ceiling_actuator import Identity, Limits, Mode, Reading
from atpid_driver.motor.errors import LinkError, MotorError, NotReadyError
from atpid_driver.motor.faults import LINK_FAULTS, in_words
from atpid_driver.motor.link import Job, Link
from atpid_driver.motor.protocol import micrometres
from atpid_driver.motor.settings import MotorSettings

JOB_TIME = 2.5


class SerialActuator:
    """A ceiling behind a serial port."""

    def __init__(self, settings: MotorSettings) -> None:
        """Remember `settings`; nothing is opened before `connect`."""
        self._settings = settings
        self._link = Link(settings)
        self._active = False
        self._recovery: Job | None = None

    @property
    def limits(self) -> Limits:
        """Limits in force: the parameters', which lie inside the firmware's."""
        return self._settings.limits

    def connect(self, now: int) -> Identity:
        """Open the port and ask for the identity until it answers; the link then reconnects by itself."""
        identity = self._link.start()
        return Identity(identity.name, identity.version, identity.boots)

    def activate(self, now: int) -> None:
        """Arm, clearing faults whose cause is gone, and start homing if the reference is lost."""
        self._link.feed()
        self._active = self._link.beating = True
        try:
            self._do(self._arming())
        except MotorError:
            self._active = self._link.beating = False
            raise

    def deactivate(self, now: int) -> None:
        """Stop and disarm: motor off. Where the link fails the firmware does so by itself within 500 ms."""
        self._active = self._link.beating = False
        with suppress(LinkError):
            self._do(Job((("DISARM", ()),)))

    def move(self, height: float, sequence: int, now: int) -> None:
        """Hand `height` [m] to the I/O thread, which sends it if it is still fresh; NaN: stop."""
        self._link.feed()
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
        """Return the last state the board reported; reading keeps the heartbeat going."""
        self._link.feed()
        return self._link.reading

    def news(self) -> list[str]:
        """Return what the link had to tell since the last call."""
        return self._link.news()

    def health(self) -> dict[str, str]:
        """Return who is there and what the link counts."""
        return self._link.health()

    def close(self) -> None:
        """Disarm if anybody still listens, and let go of the port."""
        self._active = self._link.beating = False
        self._link.stop()

    def _arming(self) -> Job:
        homed = self._link.reading.homed
        return Job((("ARM", ()),) if homed else (("ARM", ()), ("HOME", ())))

    def _recover(self, reading: Reading, goal: float) -> None:
        """Arm and home again on a fresh height after a lost link; never of itself, never after another fault.

        Commands that come while that is under way do not start it anew: they would fill the queue of a slow board.
        """
        lost = reading.mode is Mode.DISARMED or (reading.mode is Mode.FAULT and not reading.faults & ~LINK_FAULTS)
        under_way = self._recovery is not None and not self._recovery.done.done()
        if self._active and lost and isfinite(goal) and not under_way:
            job = self._arming()
            self._link.submit(job)
            self._recovery = job
        raise NotReadyError(f"ceiling height {goal:g} m not taken up: {self._why(reading)}")

    def _why(self, reading: Reading) -> str:
        if reading.mode is Mode.UNCONFIGURED:
            return "no connection to the board; it is looked for"
        if reading.mode is Mode.HOMING:
            return "homing; command it again when it is done"
        if reading.faults & ~LINK_FAULTS:
            return f"{in_words(reading.faults)}; mend it, then call ~/rearm"
        return "motor off; armed and homed again first" if self._active else "motor off; activate it"

    def _do(self, job: Job) -> None:
        """Hand in `job` and wait for its outcome, bounded."""
        job.awaited = True
        self._link.submit(job)
        try:
            job.done.result(timeout=JOB_TIME)
        except TimeoutError:
            raise LinkError(f"the board did not answer {job.commands[0][0]} within {JOB_TIME:g} s") from None
