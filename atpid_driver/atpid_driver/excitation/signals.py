# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an exciter puts out: commands become ramps of amplitude and frequency, and samples without a jump of phase.

Pure: time is what `advance` is called with. Amplitudes are of the support [m] or of a force [N].
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver import DriverError
from atpid_driver.excitation.settings import ExcitationSettings

Floats = NDArray[np.float64]
#: After so long noise repeats itself [s].
NOISE_PERIOD = 60.0
#: Between two samples of a recorded signal at least [s].
_SHORTEST_STEP = 1e-6
_MOST_BYTES = 100_000_000
#: Backends that have amplitude and frequency, and no samples.
TONES_ALONE = ("simulated", "labjack_dac")
#: Within this share a command has to be the amplitude of an eccentric drive.
_AMPLITUDE_MATCH = 0.01


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
    file: str = ""
    hold: bool = False
    sequence: int = 0

    @property
    def wave(self) -> str:
        """What sets one form of signal apart from another; of a tone, whatever its frequency, and of none empty."""
        if self.kind not in (ExciterKind.RANDOM, ExciterKind.RECORDED):
            return ""
        return repr((self.kind, self.frequency, self.end_frequency, self.seed, self.file))


OFF = Command()


def check(settings: ExcitationSettings, command: Command) -> None:
    """Raise CommandRefusedError for a command outside the limits, or one that the backend cannot put out."""
    kind, amplitude, highest = command.kind, command.amplitude, settings.highest_amplitude
    if kind is ExciterKind.OFF:
        return
    if command.wave and settings.backend in TONES_ALONE:
        raise CommandRefusedError(
            f"kind: given {kind.name}; backend {settings.backend}: allowed OFF, SINE, SWEEP, since it has "
            "amplitude and frequency alone"
        )
    if not 0.0 <= amplitude <= highest:
        raise _refused("amplitude", amplitude, f"0 to {highest:g}")
    if settings.backend == "labjack_dac" and amplitude < highest * (1.0 - _AMPLITUDE_MATCH):
        raise _refused(
            "amplitude", amplitude, f"{highest:g}, that of the disc; turn the disc and set highest_amplitude"
        )
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


def _refused(name: str, value: float, allowed: str) -> CommandRefusedError:
    return CommandRefusedError(f"{name}: given {value:g}; allowed: {allowed}; the output stays as it is")


class Point(NamedTuple):
    """The output at one instant."""

    amplitude: float  # [m] or [N]
    frequency: float  # [Hz]; of what is no tone 0


class Generator:
    """Follows commands: amplitude and frequency along ramps, the phase without a jump."""

    def __init__(self, settings: ExcitationSettings) -> None:
        """Begin with no output."""
        self.settings, self.rate = settings, settings.sample_rate  # [Hz]
        self.command = OFF
        self.amplitude = self.frequency = 0.0
        self.correct(1.0, 1.0, waits=False)
        self._turns = 0.0
        self._fall = 0.0  # of the amplitude, while it stops [1/s]
        self._arrived = False  # the output has been at the command
        self._swept = 0.0  # of the sweep [s]
        self._wave = self._next_wave = ""  # of the signal that is put out, and of the one that is ready
        self._unit = self._next_unit = np.empty(0)  # one period of what is no tone, of size 1
        self._place = 0

    def follow(self, command: Command, unit: Floats | None = None) -> None:
        """Go to `command` from what is put out now; unit: its `unit_signal`, where that has been made before.

        Raises CommandRefusedError, and changes nothing.
        """
        check(self.settings, command)
        if repr(command) == repr(self.command):  # NaN is unequal to itself
            return
        if command.kind is ExciterKind.OFF:
            self.stop()
            return
        if unit is not None or (command.wave and command.wave != self._next_wave):
            self._next_unit = unit_signal(command, self.rate) if unit is None else unit
            self._next_wave = command.wave
        self.command = command
        self._arrived, self._swept, self._fall = False, 0.0, 0.0
        self.correct(1.0, 1.0, waits=False)

    def correct(self, amplitude: float, frequency: float, waits: bool) -> None:
        """Put out so many times the command's amplitude and frequency; waits: a sweep stays where it is."""
        self.factors, self.waits = (amplitude, frequency), waits

    def stop(self) -> None:
        """Go to no output within `stop_time`."""
        if self.command.kind is not ExciterKind.OFF or not self._fall:
            self._fall = self.amplitude / self.settings.stop_time
        self.command, self.waits = OFF, False

    def cut(self) -> None:
        """Put out nothing from now on, without a ramp."""
        self.command, self.amplitude, self.frequency, self._fall = OFF, 0.0, 0.0, 0.0

    @property
    def mode(self) -> ExciterMode:
        """What the output does."""
        if self.command.kind is ExciterKind.OFF:
            return ExciterMode.STOPPING if self.amplitude else ExciterMode.OFF
        return ExciterMode.RUNNING if self._arrived else ExciterMode.RAMPING

    @property
    def commanded(self) -> Point:
        """Amplitude and frequency of the command now: a sweep's moves."""
        command = self.command
        if command.kind is ExciterKind.SWEEP:
            share = min(1.0, self._swept / command.duration)
            frequency = command.frequency + share * (command.end_frequency - command.frequency)
            return Point(command.amplitude, frequency)
        return Point(command.amplitude, command.frequency if command.kind is ExciterKind.SINE else 0.0)

    def advance(self, seconds: float) -> Point:
        """Go on by `seconds`, as `samples` does without them."""
        self._go(seconds)
        return Point(self.amplitude, self.frequency)

    def samples(self, count: int) -> Floats:
        """Return the next samples (count,) [m] or [N], 1 / rate apart; the last one is at the new instant."""
        first, begin = self._turns, Point(self.amplitude, self.frequency)
        seconds = count / self.rate
        self._go(seconds)
        share = np.arange(1, count + 1) / count
        size = begin.amplitude + share * (self.amplitude - begin.amplitude)
        if self._wave:
            places = (self._place + np.arange(count)) % len(self._unit)
            self._place = int((self._place + count) % len(self._unit))
            return np.asarray(size * self._unit[places])
        start = begin.frequency if begin.amplitude else self.frequency
        turns = first + seconds * share * (start + 0.5 * share * (self.frequency - start))
        return np.asarray(size * np.sin(2.0 * math.pi * np.mod(turns, 1.0)))

    def _go(self, seconds: float) -> None:
        before = self.frequency if self.amplitude else None
        goal = self._targets(seconds)
        slope = self.settings.highest_amplitude / self.settings.rise_time
        down = self._fall if self.command.kind is ExciterKind.OFF else slope
        self.amplitude = _toward(self.amplitude, goal.amplitude, slope * seconds, down * seconds)
        if before is None or not self.amplitude:
            self.frequency = goal.frequency if self.amplitude else self.frequency
        elif goal.frequency:
            step = self.settings.frequency_rate * seconds
            self.frequency = _toward(self.frequency, goal.frequency, step, step)
        start = self.frequency if before is None else before
        self._turns = math.fmod(self._turns + 0.5 * (start + self.frequency) * seconds, 1.0)
        self._arrived = self._arrived or (
            Point(self.amplitude, self.frequency) == goal and self.command.kind is not ExciterKind.OFF
        )

    def _targets(self, seconds: float) -> Point:
        """Return where amplitude and frequency go; the time of a sweep goes on once its begin has been reached."""
        command = self.command
        if command.kind is ExciterKind.OFF:
            return Point(0.0, self.frequency)
        if command.wave != self._wave:
            if self.amplitude:
                return Point(0.0, self.frequency)  # another form of signal begins from nothing
            self._wave, self._unit, self._place = command.wave, self._next_unit, 0
        if self._arrived and not self.waits:
            self._swept += seconds
        commanded = self.commanded
        return Point(commanded.amplitude * self.factors[0], commanded.frequency * self.factors[1])


def _toward(value: float, target: float, up: float, down: float) -> float:
    """Return `value` moved toward `target` by `up` or `down` at most."""
    return min(target, value + up) if value < target else max(target, value - down)


def unit_signal(command: Command, rate: float) -> Floats:
    """Return one period (n,) at `rate` [Hz] of noise of root mean square 1, or of a recorded signal of peak 1.

    Raises CommandRefusedError where there is none.
    """
    if command.kind is ExciterKind.RANDOM:
        return noise(command.frequency, command.end_frequency, rate, command.seed)
    return recorded(Path(command.file), rate)


def noise(low: float, high: float, rate: float, seed: int) -> Floats:
    """Return periodic Gaussian noise (n,) at `rate` [Hz], flat between `low` and `high` [Hz], root mean square 1."""
    count = round(NOISE_PERIOD * rate)
    lines = np.fft.rfftfreq(count, 1.0 / rate)
    inside = (lines >= low) & (lines <= high)
    if not inside.any() or high >= 0.5 * rate:
        raise CommandRefusedError(
            f"noise from {low:g} to {high:g} Hz; allowed: a band of at least {1.0 / NOISE_PERIOD:g} Hz below half of "
            f"the output's rate, {0.5 * rate:g} Hz"
        )
    draws = np.random.default_rng(seed).standard_normal((2, int(inside.sum())))
    spectrum = np.zeros(len(lines), dtype=complex)
    spectrum[inside] = draws[0] + 1j * draws[1]
    values = np.fft.irfft(spectrum, count)
    return np.asarray(values / np.sqrt(np.mean(values**2)))


def recorded(path: Path, rate: float) -> Floats:
    """Return the signal of a file with two columns, time [s] and value, at `rate` [Hz] without its mean, of peak 1."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"more than {_MOST_BYTES} bytes")
        try:
            table = _table(path, 0)
        except ValueError:
            table = _table(path, 1)  # without a heading
        times, values = table.T
        if len(times) < 2 or not np.isfinite(table).all() or np.diff(times).min() < _SHORTEST_STEP:
            raise ValueError("its times have to rise, and all numbers to be finite")
    except (OSError, ValueError) as error:
        text = str(error).splitlines()[0]
        raise CommandRefusedError(
            f"file: given {str(path)!r}; allowed: a text file with two columns, time [s] and value ({text})"
        ) from None
    grid = np.arange(times[0], times[-1], 1.0 / rate)
    signal = np.interp(grid, times, values)
    signal -= signal.mean()
    peak = float(np.abs(signal).max(initial=0.0))
    if not peak:
        raise CommandRefusedError(f"file: given {str(path)!r}, whose signal does not move; allowed: one that does")
    return np.asarray(signal / peak)


def _table(path: Path, skipped: int) -> Floats:
    return np.loadtxt(path, delimiter="," if path.suffix.lower() == ".csv" else None, ndmin=2, skiprows=skipped)
