# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Analogue outputs: what a generator puts out, as the voltage of a T7 or of an NI module.

Registers and calls of the T7 as in LabJack's T-series datasheet (23.0 Watchdog, 24.0 IO Config) and own examples
(labjack-ljm-python: write_watchdog_config.py, aperiodic_stream_out.py), not tried on a device: UNVERIFIED.
"""

import importlib
from abc import ABC, abstractmethod
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np

from atpid_driver.acquisition import labjack, nidaqmx
from atpid_driver.acquisition.protocol import SetupRefusedError, StreamLostError
from atpid_driver.calibration.model import Calibration, CalibrationError, load, si_of, volts_of
from atpid_exciter.excitation.drive import Output, output_of
from atpid_exciter.excitation.settings import ExcitationSettings, Floats
from atpid_exciter.excitation.signals import Generator

#: A streamed output is written so far ahead [s]: a stop waits for so long before its ramp begins.
LEAD = 0.04
#: Of the T7's stream-out that is used, and the address of its place in a scan list.
_STREAM_OUT, _STREAM_OUT_ADDRESS = 0, 4800
#: What feeds the T7's watchdog, which is strict: traffic of others keeps no output on that has lost its process.
_KEY = 0x41545049
#: After a reset the outputs rest, and the T7 waits so long for a feed until it resets again: time to open it in [s].
_STARTUP = 60.0
#: Address of IO_CONFIG_SET_DEFAULT_TO_CURRENT, which later versions of LJM name otherwise, and its type, UINT32.
_SAVE_POWER_UP, _UINT32 = 49002, 1
_DACS, _SAME = ("DAC0", "DAC1"), 5e-3  # voltages that are the same: within four steps of an output [V]


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


def load_library(settings: ExcitationSettings) -> None:
    """Load the vendor's library. Raises LibraryMissingError."""
    (nidaqmx.load_nidaqmx if settings.backend == "nidaqmx" else labjack.load_ljm)(settings.library)


class _Outlet(ABC):
    """The voltage of one output. All calls come from one thread; any may raise DriverError."""

    lead = 0.0  # from a change of the generator to that of the output [s]

    def __init__(self, settings: ExcitationSettings, calibration: Calibration) -> None:
        """Begin unopened."""
        self._settings, self._calibration = settings, calibration
        self._rest = 0.0  # [V]

    @abstractmethod
    def open(self) -> str:
        """Open the device, its output at rest and its own watchdog on; return what it is."""

    @abstractmethod
    def put(self, generator: Generator, now: float) -> Output:
        """Go on to the steady time `now` [s]; return what is put out."""

    @abstractmethod
    def rest(self) -> None:
        """Put out nothing at once."""

    @abstractmethod
    def close(self) -> None:
        """Release the device; no error if it is not open or already gone."""

    def _volts(self, values: Floats) -> Floats:
        """Return the voltages (n,) of values (n,) of the calibration, within its range."""
        return np.clip(volts_of(self._calibration, values), *self._calibration.limits_volts)


class _T7(labjack.T7, _Outlet):
    """What both outputs of a T7 share: the device, and the watchdog that switches its outputs off by itself."""

    _resets = False  # whether the watchdog resets the device, which also ends a stream
    _fed = inf  # the turn at which the watchdog was fed [s]
    _dacs: tuple[str, ...] = ()  # that rest: the signal's, and the other of a streamed one; none: the T7 is not ours

    def open(self) -> str:
        settings = self._settings
        if settings.terminal not in _DACS:
            raise SetupRefusedError(f"terminal: given {settings.terminal!r}; allowed: DAC0 or DAC1")
        found = self._connect(settings.library, settings.connection, settings.serial)
        self._dacs = (settings.terminal, *({*_DACS} - {settings.terminal} if self._resets else ()))
        self.rest()
        self._set_watchdog()
        return f"labjack:{found} {' against '.join(self._dacs)}"

    def _set_watchdog(self) -> None:
        """Arm the watchdog, and let the outputs rest after a reset and at power-up too.

        Its registers are in flash, which wears: only those that differ are written. No register has the power-up
        voltages alone: they are saved, with all that the T7 is set to now, where the watchdog was set up otherwise.
        """
        enable = "WATCHDOG_ENABLE_DEFAULT"
        wanted = {
            "WATCHDOG_TIMEOUT_S_DEFAULT": float(self._settings.watchdog),
            "WATCHDOG_STARTUP_DELAY_S_DEFAULT": _STARTUP,
            "WATCHDOG_STRICT_ENABLE_DEFAULT": 1.0,
            "WATCHDOG_STRICT_KEY_DEFAULT": float(_KEY),
            "WATCHDOG_RESET_ENABLE_DEFAULT": float(self._resets),
            **{f"WATCHDOG_{dac}_ENABLE_DEFAULT": float(dac in self._dacs) for dac in _DACS},
            **{f"WATCHDOG_{dac}_DEFAULT": self._rest for dac in self._dacs},
            enable: 1.0,
        }
        found = self._call("eReadNames", len(wanted), list(wanted))
        differ = {name: wanted[name] for name, at in zip(wanted, found, strict=True) if abs(at - wanted[name]) > _SAME}
        if differ.keys() - {enable}:
            self._call("eWriteName", enable, 0.0)  # the others cannot be written while it runs
            self._call("eWriteAddress", _SAVE_POWER_UP, _UINT32, 1.0)
            differ[enable] = 1.0
        if differ:
            self._call("eWriteNames", len(differ), list(differ), list(differ.values()))

    def _feed(self, now: float) -> None:
        """Feed the watchdog in the turn at `now` [s]. Raises StreamLostError where it has acted since the last one."""
        if now - self._fed > self._settings.watchdog:
            raise StreamLostError(f"the T7's watchdog has acted: it was not fed for {now - self._fed:.1f} s")
        self._fed = now
        self._call("eWriteName", "WATCHDOG_STRICT_CLEAR", float(_KEY))

    def rest(self) -> None:
        self._call("eWriteNames", len(self._dacs), self._dacs, [self._rest] * len(self._dacs))

    def close(self) -> None:
        """See _Outlet. The watchdog is disarmed: the device is idle, and others may use it."""
        if self._handle is None:
            return
        try:
            if self._dacs:
                self.rest()
                self._call("eWriteName", "WATCHDOG_ENABLE_DEFAULT", 0.0)
        finally:
            handle, self._handle = self._handle, None
            labjack.call(self._ljm, "close", handle)


class _T7Level(_T7):
    """An inverter's speed: the frequency of an eccentric drive, whose amplitude is that of its disc.

    The share of the amplitude that the generator's ramp has reached is the share of the frequency.
    """

    _now: float | None = None  # of the last turn [s]

    def put(self, generator: Generator, now: float) -> Output:
        self._feed(now)
        before, self._now = self._now, now
        generator.advance(0.0 if before is None else max(0.0, now - before))
        disc = self._settings.highest_amplitude
        goal = generator.frequency * min(1.0, generator.amplitude / disc)
        volts = float(self._volts(np.array([goal]))[0]) if goal > 0.0 else self._rest
        self._call("eWriteName", self._settings.terminal, volts)
        if volts == self._rest:
            return replace(output_of(generator, volts), amplitude=0.0, frequency=0.0)
        frequency = max(0.0, float(si_of(self._calibration, np.array([volts]))[0][0]))
        return replace(output_of(generator, volts), amplitude=disc, frequency=frequency)


class _Streamed(_Outlet):
    """What streamed outputs share: samples so far ahead of the clock."""

    lead = LEAD

    def __init__(self, settings: ExcitationSettings, calibration: Calibration) -> None:
        super().__init__(settings, calibration)
        self._rest = float(volts_of(calibration, np.zeros(1))[0])
        self._begin()

    def _begin(self) -> None:
        self._started: float | None = None
        self._written, self._peak = 0, nan

    def _next(self, generator: Generator, now: float) -> Floats:
        """Return the volts (n,) that are due at the steady time `now` [s]; empty: none."""
        if self._started is None:
            self._started = now
        due = round((now - self._started + LEAD) * generator.rate) - self._written
        if due <= 0:
            return np.empty(0)
        self._written += due
        volts = self._volts(generator.samples(due))
        self._peak = float(np.abs(volts - self._rest).max())
        return volts


class T7Stream(_Streamed, _T7):
    """A shaker amplifier's input, between both outputs, from the T7's stream-out, which needs its stream for itself."""

    _resets = True
    _streams = True  # perhaps, that of a process that was killed

    def put(self, generator: Generator, now: float) -> Output:
        """See _Outlet."""
        self._feed(now)
        if not self._streams:
            self._begin()
            target = int(labjack.call(self._ljm, "nameToAddress", self._settings.terminal)[0])
            self._call("initializeAperiodicStreamOut", _STREAM_OUT, target, generator.rate)
        volts = self._next(generator, now)
        if len(volts):
            self._call("writeAperiodicStreamOut", _STREAM_OUT, len(volts), volts.tolist())
        if not self._streams:
            self._call("eStreamStart", 1, 1, [_STREAM_OUT_ADDRESS], generator.rate)
            self._streams = True
        return output_of(generator, self._peak)

    def rest(self) -> None:
        """See Outlet: the stream ends, and the output is set."""
        if self._streams:
            self._streams = False
            self._call_ignoring(labjack.STOPPED_ALREADY, "eStreamStop")
        super().rest()


class _NiStream(_Streamed):
    """A shaker amplifier's input from an NI module such as the 9263; no watchdog of its chassis is used."""

    def __init__(self, settings: ExcitationSettings, calibration: Calibration) -> None:
        """Begin unopened."""
        super().__init__(settings, calibration)
        self._nidaqmx: Any = None
        self._task: Any = None

    def open(self) -> str:
        self._nidaqmx = nidaqmx.load_nidaqmx(self._settings.library)
        self.rest()
        return (
            f"nidaqmx {self._settings.terminal} (no watchdog: where both processes end at once the last "
            "voltage stays; the amplifier's enable must be on the emergency stop's relay)"
        )

    def put(self, generator: Generator, now: float) -> Output:
        with nidaqmx.named_errors(self._nidaqmx):
            starts = self._task is None
            if starts:
                self._begin()
                self._task, self._writer = self._made()
                constants, rate = self._nidaqmx.constants, generator.rate
                self._task.timing.cfg_samp_clk_timing(
                    rate, sample_mode=constants.AcquisitionType.CONTINUOUS, samps_per_chan=round(rate)
                )
                self._task.out_stream.regen_mode = constants.RegenerationMode.DONT_ALLOW_REGENERATION
            volts = self._next(generator, now)
            if len(volts):
                self._writer.write_many_sample(volts)
            if starts:
                self._task.start()
        return output_of(generator, self._peak)

    def rest(self) -> None:
        """See Outlet: the stream ends, and one sample is written at once."""
        with nidaqmx.named_errors(self._nidaqmx):
            task, self._task = self._task, None
            if task is not None:
                task.close()
            task, writer = self._made()
            try:
                writer.write_one_sample(self._rest)
            finally:
                task.close()

    def close(self) -> None:
        if self._nidaqmx is not None:
            self.rest()

    def _made(self) -> tuple[Any, Any]:
        """Return a task of the output, and its writer."""
        writers = importlib.import_module("nidaqmx.stream_writers")
        task, (low, high) = self._nidaqmx.Task(), self._calibration.limits_volts
        try:
            task.ao_channels.add_ao_voltage_chan(self._settings.terminal, min_val=low, max_val=high)
        except Exception:
            task.close()
            raise
        writer = writers.AnalogSingleChannelWriter(task.out_stream)
        writer.verify_array_shape = False
        return task, writer


OUTLETS: dict[str, type[_T7 | _NiStream]] = {"labjack_dac": _T7Level, "labjack_stream": T7Stream, "nidaqmx": _NiStream}
