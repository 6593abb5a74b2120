# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every exciter's output does, and the simulated one."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import nan

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import DriverError, NotReadyError
from atpid_exciter.excitation.settings import Command, ExcitationSettings, Floats, Point, check, check_unit
from atpid_exciter.excitation.signals import Generator, resampled, unit_signal

#: A turn that comes later than this begins anew: nothing is made up for [s].
_MOST_LATE = 1.0
NOWHERE = Point(0.0, 0.0)


class OutputLostError(DriverError):
    """The device is missing, taken or has been lost; its output cannot be confirmed."""


@dataclass(frozen=True, slots=True)
class Output:
    """What is put out at one instant."""

    mode: ExciterMode
    kind: ExciterKind = ExciterKind.OFF
    sequence: int = 0  # of the command followed
    amplitude: float = 0.0  # by the calibration [m] or [N]
    frequency: float = 0.0  # [Hz]
    commanded: Point = NOWHERE  # by the command, now
    volts: float = nan  # peak; NaN: there is none
    limited: bool = False  # more was asked for than the limits allow
    ended: str = ""  # why the output has ended by itself; it follows nothing until `off`


class ExcitationDrive(ABC):
    """An exciter's output. All calls come from one thread; any may raise DriverError."""

    def __init__(self, settings: ExcitationSettings) -> None:
        """Begin unconnected."""
        self._settings = settings
        self._enabled = False
        self._recorded: tuple[str, Floats] | None = None  # name and one period of the recorded signal

    @abstractmethod
    def connect(self) -> str:
        """Open the device with its output off, and return what it is."""

    def enable(self) -> None:
        """Let commands switch the output on."""
        self._enabled = True

    def take(self, name: str, values: Floats, rate: float) -> None:
        """Keep the samples (n,) at `rate` [Hz] of a recorded signal alone. Raises CommandRefusedError."""
        self._recorded = name, resampled(values, rate, self._settings.sample_rate)

    def follow(self, command: Command) -> None:
        """Follow `command` along ramps. Raises CommandRefusedError and NotReadyError; the output stays as it is."""
        if not self._enabled:
            raise NotReadyError("the output is off: activate the excitation node")
        check(self._settings, command)
        if not command.wave:
            self._act("follow", command)
            return
        known = self._recorded is not None and self._recorded[0] == command.file
        recorded = self._recorded[1] if self._recorded and known else None
        unit = unit_signal(command, self._settings.sample_rate, recorded)
        check_unit(self._settings, command, unit)
        self._act("follow", command, unit)

    def correct(self, amplitude: float, frequency: float, *, waits: bool) -> None:
        """Put out so many times the command's amplitude and frequency; waits: a sweep stays where it is."""
        self._act("correct", amplitude, frequency, waits)

    def stop(self) -> None:
        """Ramp down within `stop_time`."""
        self._act("stop")

    @abstractmethod
    def turn(self, now: int, /) -> Output:
        """Go on to the steady time `now` [ns] and return the output; the output ends where these calls end."""

    @abstractmethod
    def off(self) -> None:
        """Return when the output is off, at most `stop_time` later; it stays off until `enable`.

        Raises OutputLostError where the device does not confirm it.
        """

    @abstractmethod
    def close(self) -> None:
        """Switch off and release the device; no error if it is not open or already gone."""

    @abstractmethod
    def _act(self, method: str, *arguments: object) -> None:
        """Call a method of the generator, wherever it is."""


class SimulatedDrive(ExcitationDrive):
    """The support, or the force, of a simulated plant, which follows what this puts out."""

    def __init__(self, settings: ExcitationSettings) -> None:
        """Begin unconnected."""
        super().__init__(settings)
        self._generator = Generator(settings)
        self._connected = False
        self._now: int | None = None

    def connect(self) -> str:
        """See ExcitationDrive."""
        self._connected = True
        return "simulated exciter"

    def turn(self, now: int, /) -> Output:
        """See ExcitationDrive."""
        elapsed, self._now = (0.0 if self._now is None else (now - self._now) * 1e-9), now
        self._generator.advance(min(max(elapsed, 0.0), _MOST_LATE))
        return output_of(self._generator) if self._connected else Output(ExciterMode.UNCONFIGURED)

    def off(self) -> None:
        """See ExcitationDrive: at once, since a plant ramps down by itself until its next sample."""
        self._enabled = False
        self._generator.cut()

    def close(self) -> None:
        """See ExcitationDrive."""
        self.off()
        self._connected = False

    def _act(self, method: str, *arguments: object) -> None:
        getattr(self._generator, method)(*arguments)


def output_of(generator: Generator, volts: float = nan) -> Output:
    """Return what a generator puts out."""
    command, now = generator.command, (generator.amplitude, generator.frequency if generator.amplitude else 0.0)
    limited = generator.clamp.limited
    return Output(
        generator.mode, command.kind, command.sequence, *now, generator.commanded, volts, limited, generator.ended
    )
