# SPDX-License-Identifier: Apache-2.0
"""Analogue outputs: what a generator puts out, as the voltage of a T7 or of an NI module.

Registers and calls of the T7 as in LabJack's own examples (labjack-ljm-python: write_watchdog_config.py,
aperiodic_stream_out.py), not tried on a device: UNVERIFIED.
"""

from math import nan
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from atpid_common.vocabulary import ExciterKind
from atpid_driver.acquisition import labjack
from atpid_driver.acquisition.errors import AcquisitionError, SetupRefusedError
from atpid_driver.calibration.convert import si_of, volts_of
from atpid_driver.calibration.model import Calibration, CalibrationError, load
from atpid_driver.excitation.errors import CommandRefusedError
from atpid_driver.excitation.settings import ExcitationSettings
from atpid_driver.excitation.signals import Command, Generator

#: A streamed output is written so far ahead [s]: a stop waits for so long before its ramp begins.
LEAD = 0.04
#: Of the T7's stream-out that is used, and the address of its place in a scan list.
_STREAM_OUT, _STREAM_OUT_ADDRESS = 0, 4800
_AMPLITUDE_MATCH = 0.01


def calibration_of(settings: ExcitationSettings, folder: Path) -> Calibration:
    """Return the output's calibration, from `calibration_folder`, else `folder`. Raises CalibrationError."""
    wanted = "drive_frequency" if settings.backend == "labjack_dac" else "drive_amplitude"
    found = load((Path(settings.calibration_folder) if settings.calibration_folder else folder) / settings.calibration)
    if found.channel != wanted:
        raise CalibrationError(
            f"calibration {settings.calibration}: given channel {found.channel}; backend {settings.backend}: allowed "
            f"{wanted}"
        )
    return found


def check_command(settings: ExcitationSettings, command: Command) -> None:
    """Raise CommandRefusedError for a command that the backend cannot put out, whatever its limits."""
    if settings.backend != "labjack_dac" or command.kind is ExciterKind.OFF:
        return
    if command.kind in (ExciterKind.RANDOM, ExciterKind.RECORDED):
        raise CommandRefusedError(f"kind: given {command.kind.name}; an eccentric drive: allowed OFF, SINE, SWEEP")
    disc = settings.highest_amplitude
    if abs(command.amplitude / disc - 1.0) > _AMPLITUDE_MATCH:
        raise CommandRefusedError(
            f"amplitude: given {command.amplitude:g}; an eccentric drive: allowed {disc:g}, that of its disc "
            "(highest_amplitude); turn the disc and set it"
        )


class Outlet(Protocol):
    """The voltage of one output. All calls come from one thread; any may raise DriverError."""

    lead: float  # from a change of the generator to that of the output [s]

    def open(self) -> str:
        """Open the device, its output at rest and its own watchdog on; return what it is."""

    def put(self, generator: Generator, now: float) -> tuple[float, float, float]:
        """Go on to the steady time `now` [s]; return amplitude, frequency [Hz] and peak [V] of the output."""

    def rest(self) -> None:
        """Put out nothing at once."""

    def close(self) -> None:
        """Release the device; no error if it is not open or already gone."""


class _T7:
    """What both outputs of a T7 share: the device, and the watchdog that switches its outputs off by itself."""

    lead = 0.0
    _resets = False  # whether the watchdog resets the device, which also ends a stream

    def __init__(self, settings: ExcitationSettings, calibration: Calibration) -> None:
        self._settings, self._calibration = settings, calibration
        self._ljm: Any = None
        self._handle: int | None = None
        self._now: float | None = None
        self._rest = 0.0  # [V]

    def open(self) -> str:
        """See Outlet."""
        settings = self._settings
        if settings.terminal not in ("DAC0", "DAC1"):
            raise SetupRefusedError(f"terminal: given {settings.terminal!r}; allowed: DAC0 or DAC1")
        self._ljm = labjack.load_ljm(settings.library)
        self._handle = labjack.open_t7(self._ljm, settings.connection, settings.serial)
        found = int(self._call("getHandleInfo")[2])
        if settings.serial not in (0, found):
            self.close()
            raise SetupRefusedError(f"the T7 has serial number {found}, expected {settings.serial}: set `serial`")
        self.rest()
        self._set_watchdog()
        return f"labjack:{found} {settings.terminal}"

    def _set_watchdog(self) -> None:
        """Arm the watchdog, which every call sets back; its registers are in flash, so only where they differ."""
        terminal = self._settings.terminal
        wanted = {
            "WATCHDOG_TIMEOUT_S_DEFAULT": float(self._settings.watchdog),
            "WATCHDOG_RESET_ENABLE_DEFAULT": float(self._resets),
            f"WATCHDOG_{terminal}_ENABLE_DEFAULT": 1.0,
            f"WATCHDOG_{terminal}_DEFAULT": self._rest,
        }
        names = [*wanted, "WATCHDOG_ENABLE_DEFAULT"]
        if self._call("eReadNames", len(names), names) == [*wanted.values(), 1.0]:
            return
        names, values = ["WATCHDOG_ENABLE_DEFAULT", *names], [0.0, *wanted.values(), 1.0]
        self._call("eWriteNames", len(names), names, values)

    def _elapsed(self, now: float) -> float:
        before, self._now = self._now, now
        return 0.0 if before is None else max(0.0, now - before)

    def _call(self, name: str, *arguments: object) -> Any:
        return labjack.call(self._ljm, name, self._handle, *arguments)

    def rest(self) -> None:
        """See Outlet."""
        self._call("eWriteName", self._settings.terminal, self._rest)

    def close(self) -> None:
        """See Outlet. The watchdog is disarmed: the device is idle, and others may use it."""
        if self._handle is None:
            return
        try:
            self.rest()
            self._call("eWriteName", "WATCHDOG_ENABLE_DEFAULT", 0.0)
        finally:
            handle, self._handle = self._handle, None
            labjack.call(self._ljm, "close", handle)


class T7Level(_T7):
    """An inverter's speed: the frequency of an eccentric drive, whose amplitude is that of its disc.

    The share of the amplitude that the generator's ramp has reached is the share of the frequency.
    """

    def put(self, generator: Generator, now: float) -> tuple[float, float, float]:
        """See Outlet."""
        generator.advance(self._elapsed(now))
        disc = self._settings.highest_amplitude
        wanted = generator.frequency * min(1.0, generator.amplitude / disc)
        volts = self._rest
        if wanted > 0.0:
            low, high = self._calibration.limits_volts
            volts = float(np.clip(volts_of(self._calibration, np.array([wanted])), low, high)[0])
        self._call("eWriteName", self._settings.terminal, volts)
        if volts == self._rest:
            return 0.0, 0.0, volts
        return disc, max(0.0, float(si_of(self._calibration, np.array([volts]))[0][0])), volts


class _Streamed:
    """What streamed outputs share: samples so far ahead of the clock."""

    _calibration: Calibration
    _settings: ExcitationSettings

    lead = LEAD

    def _begin(self) -> None:
        self._rest = float(volts_of(self._calibration, np.zeros(1))[0])
        self._started: float | None = None
        self._written, self._peak = 0, nan

    def _next(self, generator: Generator, now: float, rate: float) -> NDArray[np.float64]:
        """Return the volts (n,) that are due at the steady time `now` [s]; empty: none."""
        if self._started is None:
            self._started = now
        due = round((now - self._started + LEAD) * rate) - self._written
        if due <= 0:
            return np.empty(0)
        self._written += due
        low, high = self._calibration.limits_volts
        volts = np.clip(volts_of(self._calibration, generator.samples(due)), low, high)
        self._peak = float(np.abs(volts - self._rest).max())
        return np.asarray(volts)


class T7Stream(_Streamed, _T7):
    """A shaker amplifier's input from the T7's stream-out, which needs the device's stream for itself."""

    _resets = True

    def open(self) -> str:
        """See Outlet."""
        self._begin()
        self._streams = True  # perhaps, that of a process that was killed
        return super().open()

    def put(self, generator: Generator, now: float) -> tuple[float, float, float]:
        """See Outlet."""
        if not self._streams:
            self._begin()
            target = int(labjack.call(self._ljm, "nameToAddress", self._settings.terminal)[0])
            self._call("initializeAperiodicStreamOut", _STREAM_OUT, target, generator.rate)
        volts = self._next(generator, now, generator.rate)
        if len(volts):
            self._call("writeAperiodicStreamOut", _STREAM_OUT, len(volts), volts.tolist())
        if not self._streams:
            self._call("eStreamStart", 1, 1, [_STREAM_OUT_ADDRESS], generator.rate)
            self._streams = True
        return generator.amplitude, generator.frequency if generator.amplitude else 0.0, self._peak

    def rest(self) -> None:
        """See Outlet: the stream ends, and the output is set."""
        if self._streams:
            self._streams = False
            try:
                self._call("eStreamStop")
            except AcquisitionError as error:
                if error.code not in labjack.STOPPED_ALREADY:
                    raise
        super().rest()
