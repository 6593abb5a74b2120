# SPDX-License-Identifier: Apache-2.0
"""The protocol that every exciter's output implements, and the simulated one. Times are integer nanoseconds."""

from dataclasses import dataclass
from math import nan
from typing import Protocol

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver.excitation.errors import CommandRefusedError, NotReadyError
from atpid_driver.excitation.signals import Command, Generator, Limits, Point

#: A turn that comes later than this begins anew: nothing is made up for [s].
MOST_LATE = 1.0


@dataclass(frozen=True, slots=True)
class Output:
    """What is put out at one instant."""

    mode: ExciterMode
    kind: ExciterKind = ExciterKind.OFF
    sequence: int = 0  # of the command followed
    amplitude: float = 0.0  # by the calibration [m] or [N]
    frequency: float = 0.0  # [Hz]
    wanted: Point = Point(0.0, 0.0)  # of the command, now
    volts: float = nan  # peak; NaN: there is none


class ExcitationDrive(Protocol):
    """An exciter's output. All calls come from one thread; any may raise ExcitationError."""

    def connect(self, now: int) -> str:
        """Open the device with its output off, and return what it is."""

    def enable(self, now: int) -> None:
        """Let commands switch the output on."""

    def follow(self, command: Command, now: int) -> None:
        """Follow `command` along ramps. Raises CommandRefusedError and NotReadyError; the output stays as it is."""

    def correct(self, amplitude: float, frequency: float, *, waits: bool) -> None:
        """Put out so many times the command's amplitude and frequency; waits: a sweep stays where it is."""

    def turn(self, now: int) -> Output:
        """Go on to `now` and return the output; the output ends where these calls end."""

    def stop(self, now: int) -> None:
        """Ramp down within `stop_time`."""

    def off(self, now: int) -> None:
        """Return when the output is off, at most `stop_time` later; it stays off until `enable`.

        Raises OutputLostError where the device does not confirm it.
        """

    def close(self) -> None:
        """Switch off and release the device; no error if it is not open or already gone."""


class SimulatedDrive:
    """The support, or the force, of a simulated plant, which follows what this puts out."""

    def __init__(self, limits: Limits) -> None:
        """Begin unconnected."""
        self._generator = Generator(limits)
        self._connected = self._enabled = False
        self._now = 0

    def connect(self, now: int) -> str:
        """See ExcitationDrive."""
        self._connected, self._now = True, now
        return "simulated exciter"

    def enable(self, now: int) -> None:
        """See ExcitationDrive."""
        self._enabled = True

    def follow(self, command: Command, now: int) -> None:
        """See ExcitationDrive. A plant follows amplitude and frequency, so tones alone."""
        if command.kind in (ExciterKind.RANDOM, ExciterKind.RECORDED):
            raise CommandRefusedError(
                f"kind: given {command.kind.name}; backend simulated: allowed OFF, SINE, SWEEP, since a plant follows "
                "amplitude and frequency; write it as the scene's excitation"
            )
        if not self._enabled:
            raise NotReadyError("the output is off: activate the excitation node")
        self._generator.follow(command)

    def correct(self, amplitude: float, frequency: float, *, waits: bool) -> None:
        """See ExcitationDrive."""
        self._generator.factors, self._generator.waits = (amplitude, frequency), waits

    def turn(self, now: int) -> Output:
        """See ExcitationDrive."""
        elapsed, self._now = (now - self._now) * 1e-9, now
        self._generator.advance(min(max(elapsed, 0.0), MOST_LATE))
        return output_of(self._generator) if self._connected else Output(ExciterMode.UNCONFIGURED)

    def stop(self, now: int) -> None:
        """See ExcitationDrive."""
        self._generator.stop()

    def off(self, now: int) -> None:
        """See ExcitationDrive: at once, since a plant ramps down by itself until its next sample."""
        self._enabled = False
        self._generator.cut()

    def close(self) -> None:
        """See ExcitationDrive."""
        self.off(self._now)
        self._connected = False


def output_of(generator: Generator, volts: float = nan) -> Output:
    """Return what a generator puts out."""
    command = generator.command
    return Output(generator.mode, command.kind, command.sequence, generator.amplitude,
                  generator.frequency if generator.amplitude else 0.0, generator.wanted, volts)  # fmt: skip
