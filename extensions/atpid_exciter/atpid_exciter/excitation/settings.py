# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an exciter may be commanded to put out, and the clamp that what goes out passes last.

Pure. A command outside the limits is refused. The clamp is for what follows from a command that is not: no correction,
no defect and no kind of signal gets round it. Amplitudes are of the support [m] or of a force [N].
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common.parameters import setting
from atpid_common.vocabulary import ExciterKind
from atpid_driver import DriverError, SettingsError
from atpid_driver.settings import SupervisedSettings

BACKENDS: Final = ("simulated", "labjack_dac", "labjack_stream", "nidaqmx")


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings(SupervisedSettings):
    """Parameters of the excitation node, SI units. Amplitudes are of the support [m], or of a driving force [N]."""

    backend: str = setting(
        str,
        "what is commanded: the simulated plant's support or force, a T7's analogue output as an inverter's speed, "
        "its stream-out or an NI module's output as a shaker amplifier's input",
        choices=BACKENDS,
    )
    highest_amplitude: float = setting(
        float, "most that may be commanded [m, of a force N]; of labjack_dac the disc's, the only one", "", 1e-9, 1e6
    )
    lowest_frequency: float = setting(float, "lowest frequency that may be commanded", "Hz", 0.0, 1e5)
    highest_frequency: float = setting(float, "highest frequency that may be commanded", "Hz", 0.0, 1e5)
    rise_time: float = setting(2.0, "from no output to the largest amplitude", "s", 0.01, 600.0)
    frequency_rate: float = setting(
        1.0, "the frequency changes no faster; a faster sweep is refused", "Hz/s", 1e-4, 1e4
    )
    stop_time: float = setting(0.05, "from any output to none, after a stop and without commands", "s", 0.01, 0.15)
    rate: float = setting(20.0, "states published per second; not used in lockstep", "Hz", 20.0, 200.0)
    stale_timeout: float = setting(
        1.2, "silence of excitation/command after which the output ramps down; not used in lockstep", "s", 0.1, 60.0
    )
    hold_tolerance: float = setting(
        0.01, "with hold: amplitude and frequency are held within this share", "-", 1e-4, 0.5
    )
    most_correction: float = setting(
        3.0, "with hold: the output is at most this many times the command's, or its inverse", "-", 1.0, 100.0
    )
    hold_timeout: float = setting(
        2.0, "with hold: so long without a usable estimate, and five periods at least, end the output", "s", 0.2, 60.0
    )
    saturation_time: float = setting(
        2.0, "with hold: so long at its limits, the command missed beyond the tolerance, end the output", "s", 0.1, 60.0
    )
    calibration: str = setting(
        "", "calibration file of the output, channel drive_frequency [Hz] of labjack_dac, else drive_amplitude"
    )
    calibration_folder: str = setting("", "folder of that file; empty: that of the package's files")
    terminal: str = setting("DAC0", "analogue output: DAC0 or DAC1 of a T7, cDAQ1Mod4/ao0 of an NI module")
    serial: int = setting(0, "serial number of the T7; 0: any", "", 0, 2**31 - 1)
    connection: str = setting("ANY", "how the T7 is connected", choices=("ANY", "USB", "TCP", "ETHERNET", "WIFI"))
    sample_rate: float = setting(2000.0, "samples per second of a streamed output", "Hz", 100.0, 50_000.0)
    watchdog: int = setting(
        3, "the T7 itself lets its outputs rest after it, all processes gone; LabJack: not below 2 to 3 s", "s", 3, 60
    )
    library: str = setting("", "path of the vendor's library; empty: that of the system")

    def __post_init__(self) -> None:
        """Raise `SettingsError` for an invalid value."""
        super().__post_init__()
        if not 0.0 < self.lowest_frequency < self.highest_frequency:
            raise SettingsError(
                f"lowest_frequency {self.lowest_frequency:g} Hz, highest_frequency {self.highest_frequency:g} Hz: need "
                "0 < lowest < highest"
            )
        if self.backend != "simulated" and not self.calibration:
            raise SettingsError("calibration is empty: give the file that converts the output's voltage")
        if self.backend != "simulated" and self.lockstep:
            raise SettingsError(f"lockstep with backend {self.backend}: a real output has its own clock")


Floats = NDArray[np.float64]
#: Backends that have amplitude and frequency, and no samples.
TONES_ALONE = ("simulated", "labjack_dac")
#: Within this share a command has to be the amplitude of an eccentric drive.
_AMPLITUDE_MATCH = 0.01
#: What rounding may add to a limit [-].
_ROUNDING = 1e-9


class CommandRefusedError(DriverError):
    """A command outside the limits, or one that the backend cannot put out; the output stays as it is."""


@dataclass(frozen=True, slots=True)
class Command:
    """What is to be put out; see ExcitationCommand.msg."""

    kind: ExciterKind = ExciterKind.OFF
    amplitude: float = 0.0  # [m] or [N]: of a tone and of a recorded signal the peak, of noise the root mean square
    frequency: float = 0.0  # [Hz]
    end_frequency: float = math.nan  # [Hz]
    duration: float = math.nan  # of a sweep [s]
    seed: int = 0
    file: str = ""  # name of the `excitation/signal` that has the samples
    hold: bool = False
    sequence: int = 0

    @property
    def wave(self) -> str:
        """What sets one form of signal apart from another; of a tone, whatever its frequency, and of none empty."""
        if self.kind not in (ExciterKind.RANDOM, ExciterKind.RECORDED):
            return ""
        return repr((self.kind, self.frequency, self.end_frequency, self.seed, self.file))


OFF = Command()


class Point(NamedTuple):
    """The output at one instant."""

    amplitude: float  # [m] or [N]
    frequency: float  # [Hz]; of what is no tone 0


class SignalError(DriverError):
    """The samples to be put out are no numbers."""


def check(settings: ExcitationSettings, command: Command) -> None:
    """Raise CommandRefusedError for a command outside the limits, or one that the backend cannot put out."""
    kind, amplitude, highest = command.kind, command.amplitude, settings.highest_amplitude
    if kind is ExciterKind.OFF:
        return
    if command.wave:
        _check_wave(settings, command)
    if not 0.0 <= amplitude <= highest:
        raise _refused("amplitude", amplitude, f"0 to {highest:g}")
    if settings.backend == "labjack_dac" and amplitude < highest * (1.0 - _AMPLITUDE_MATCH):
        allowed = f"{highest:g}, that of the disc; turn the disc and set highest_amplitude"
        raise _refused("amplitude", amplitude, allowed)
    names = {ExciterKind.SINE: ("frequency",), ExciterKind.RECORDED: ()}.get(kind, ("frequency", "end_frequency"))
    low, high = settings.lowest_frequency, settings.highest_frequency
    for name in names:
        if not low <= (value := getattr(command, name)) <= high:
            raise _refused(name, value, f"{low:g} to {high:g} Hz")
    if kind is ExciterKind.RANDOM and not command.frequency < command.end_frequency:
        raise _refused("end_frequency", command.end_frequency, f"above frequency, {command.frequency:g} Hz")
    if kind is ExciterKind.SWEEP:
        shortest = abs(command.end_frequency - command.frequency) / settings.frequency_rate
        if not max(shortest, 1e-3) <= command.duration < math.inf:
            raise _refused("duration", command.duration, f"at least {shortest:g} s, {settings.frequency_rate:g} Hz/s")


def _check_wave(settings: ExcitationSettings, command: Command) -> None:
    if settings.backend in TONES_ALONE:
        raise CommandRefusedError(
            f"kind: given {command.kind.name}; backend {settings.backend}: allowed OFF, SINE, SWEEP, since it has "
            "amplitude and frequency alone"
        )
    if command.hold:
        raise CommandRefusedError(f"hold: given with {command.kind.name}; allowed: with SINE and SWEEP, alone")


def check_unit(settings: ExcitationSettings, command: Command, unit: Floats) -> None:
    """Raise CommandRefusedError where `command` times one period `unit` (n,) of its signal is outside the limits.

    Its peak counts, which of noise is four and more times its root mean square, and its rate of change, at most that
    of a tone at the largest amplitude and frequency. Where its end is not its begin the clamp joins them.
    """
    peak = float(np.abs(unit).max())
    if command.amplitude * peak > settings.highest_amplitude * (1.0 + _ROUNDING):
        most = settings.highest_amplitude / peak
        raise _refused("amplitude", command.amplitude, f"at most {most:.3g}, whose peak is the largest amplitude")
    slew = command.amplitude * float(np.abs(np.diff(unit)).max(initial=0.0)) * settings.sample_rate
    fastest = 2.0 * math.pi * settings.highest_frequency * settings.highest_amplitude
    if slew > fastest * (1.0 + _ROUNDING):
        most = command.amplitude * fastest / slew
        raise _refused("amplitude", command.amplitude, f"at most {most:.3g}, since its signal changes so fast")


def _refused(name: str, value: float, allowed: str) -> CommandRefusedError:
    return CommandRefusedError(f"{name}: given {value:g}; allowed: {allowed}; the output stays as it is")


class Clamp:
    """Keeps what goes out within amplitude, frequency and rate of change. `limited`: whether more was asked for."""

    def __init__(self, settings: ExcitationSettings) -> None:
        """Begin at rest."""
        self._highest = settings.highest_amplitude  # [m] or [N]
        self._band = settings.lowest_frequency, settings.highest_frequency  # [Hz]
        # of a tone at both limits, while its amplitude goes up or down as fast as it may
        ramp = max(1.0 / settings.stop_time, 1.0 / settings.rise_time)
        self._slew = self._highest * (2.0 * math.pi * settings.highest_frequency + ramp) / settings.sample_rate
        self._last = 0.0
        self.limited = False

    def point(self, amplitude: float, frequency: float, peak: float = 1.0) -> Point:
        """Return amplitude [m] or [N] and frequency [Hz] within the limits; frequency 0: no tone.

        peak: largest value of the signal, which the amplitude multiplies [-].
        """
        most = self._highest / max(peak, 1.0)
        within = Point(min(amplitude, most), min(max(frequency, self._band[0]), self._band[1]) if frequency else 0.0)
        self.limited = amplitude > most * (1.0 + _ROUNDING) or within.frequency != frequency
        return within

    def samples(self, values: Floats) -> Floats:
        """Return `values` (n,) within the limits. Raises SignalError where one is no number."""
        if not np.isfinite(values).all():
            raise SignalError("the signal to be put out is no number; the output is switched off")
        within = np.clip(values, -self._highest, self._highest)
        if len(within) and np.abs(np.diff(within, prepend=self._last)).max() > self._slew * (1.0 + _ROUNDING):
            last = self._last
            for place, value in enumerate(within):
                last = min(max(value, last - self._slew), last + self._slew)
                within[place] = last
        self.limited = self.limited or bool((np.abs(within - values) > _ROUNDING * self._highest).any())
        self._last = float(within[-1]) if len(within) else self._last
        return within

    def rest(self) -> None:
        """Begin at rest again."""
        self._last, self.limited = 0.0, False
