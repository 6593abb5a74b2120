# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an exciter puts out: commands become ramps of amplitude and frequency, and samples without a jump of phase.

Pure: time is what `advance` is called with. Amplitudes are of the support [m] or of a force [N]. Whatever is commanded
and by however much it is corrected, what goes out is within the limits: `Generator` clamps it last.
"""

import math
from pathlib import Path

import numpy as np

from atpid_common.files import FileError, read_text
from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_exciter.excitation.settings import (
    OFF,
    Clamp,
    Command,
    CommandRefusedError,
    ExcitationSettings,
    Floats,
    Point,
    check,
    check_unit,
)

#: Largest file [bytes], most samples, longest signal [s]; largest rate, so the shortest step between two times [Hz].
_MOST_BYTES, MOST_SAMPLES, LONGEST, _FASTEST = 20_000_000, 1_000_000, 600.0, 50_000.0


def read_recorded(path: Path) -> tuple[float, Floats]:
    """Return the rate [Hz] and the samples (n,) of a text file with two columns, time [s] and value.

    They are taken at the shortest step of its times, without their mean, with a peak of 1. Raises FileError.
    """
    text = read_text(path, _MOST_BYTES)
    try:
        table = _table(text, "," if path.suffix.lower() == ".csv" else None)
        if table.shape[1] != 2 or len(table) < 2 or not np.isfinite(table).all():
            raise ValueError("all numbers have to be finite")
        times, values = table.T
        steps = np.diff(times)
        rate = 1.0 / steps.min() if steps.min() > 0.0 else np.inf
        if rate > _FASTEST or (length := times[-1] - times[0]) > LONGEST or length * rate > MOST_SAMPLES:
            most = f"{LONGEST:g} s at most, to at most {MOST_SAMPLES} samples of the shortest step"
            raise ValueError(f"its times have to rise by {1.0 / _FASTEST:g} s at least, over {most}")
        return float(rate), scaled(np.interp(np.arange(times[0], times[-1], 1.0 / rate), times, values))
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise FileError(f"{path}: allowed: two columns, time [s] and value ({reason})") from None


def resampled(values: Floats, rate: float, at: float) -> Floats:
    """Return `values` (n,) at `rate` [Hz] as samples at the rate `at` [Hz], without their mean, with a peak of 1.

    Raises CommandRefusedError for what is no number, or too much of it.
    """
    length = len(values) / rate
    if not np.isfinite(values).all() or not 0.0 < length <= LONGEST or len(values) > MOST_SAMPLES:
        raise CommandRefusedError(
            f"signal: given {len(values)} samples over {length:g} s; allowed: finite numbers, at most {MOST_SAMPLES}, "
            f"at most {LONGEST:g} s"
        )
    times = np.arange(len(values)) / rate
    try:
        return scaled(np.interp(np.arange(0.0, times[-1], 1.0 / at), times, values))
    except ValueError as error:
        raise CommandRefusedError(f"signal: {error}") from None


def scaled(values: Floats) -> Floats:
    """Return `values` (n,) without their mean, with a peak of 1. Raises ValueError where they do not move."""
    largest = np.abs(values).max(initial=0.0)
    within = values / largest if largest else values  # sums of the largest numbers have no place
    moving = within - (within.mean() if len(within) else 0.0)
    peak = np.abs(moving).max(initial=0.0)
    if not peak > 0.0:
        raise ValueError("the signal does not move; allowed: one that does")
    return np.asarray(moving / peak)


def _table(text: str, delimiter: str | None) -> Floats:
    """Return the numbers (n, m) of a text, whose first line may be a heading. Raises ValueError."""
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise ValueError(f"{len(lines)} lines")
    try:
        return np.loadtxt(lines, delimiter=delimiter, ndmin=2)
    except ValueError:
        return np.loadtxt(lines[1:], delimiter=delimiter, ndmin=2)


#: After so long noise repeats itself [s].
_NOISE_PERIOD = 60.0


class Generator:
    """Follows commands: amplitude and frequency along ramps, the phase without a jump, all within the limits.

    One that has ended by itself, for the reason `ended`, follows nothing until it is cut.
    """

    def __init__(self, settings: ExcitationSettings) -> None:
        """Begin with no output."""
        self.settings, self.rate = settings, settings.sample_rate  # [Hz]
        self.command = OFF
        self.clamp = Clamp(settings)
        self.ended = ""
        self.amplitude = self.frequency = 0.0
        self.correct(1.0, 1.0, waits=False)
        self._turns = 0.0
        self._fall = 0.0  # of the amplitude, while it stops [1/s]
        self._arrived = False  # the output has been at the command
        self._swept = 0.0  # of the sweep [s]
        self._wave = self._next_wave = ""  # of the signal that is put out, and of the one that is ready
        self._unit = self._next_unit = np.empty(0)  # one period of what is no tone, of size 1
        self._place, self._peak = 0, 1.0  # in that period, and its largest value

    def end(self, reason: str) -> None:
        """Ramp down for this reason, and follow nothing until `cut`."""
        if self.command.kind is not ExciterKind.OFF:
            self.ended = reason
        self.stop()

    def follow(self, command: Command, unit: Floats | None = None) -> None:
        """Go to `command` from what is put out now; unit: one period (n,) of what is no tone; default: of noise.

        Raises CommandRefusedError, and changes nothing.
        """
        check(self.settings, command)
        if self.ended or repr(command) == repr(self.command):  # NaN is unequal to itself
            return
        if command.kind is ExciterKind.OFF:
            self.stop()
            return
        if command.wave and command.wave != self._next_wave:
            unit = unit_signal(command, self.rate) if unit is None else unit
            check_unit(self.settings, command, unit)
            self._next_unit, self._next_wave = unit, command.wave
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
        self.command, self.waits, self.clamp.limited = OFF, False, False

    def cut(self) -> None:
        """Put out nothing from now on, without a ramp."""
        self.command, self.amplitude, self.frequency, self._fall, self.ended = OFF, 0.0, 0.0, 0.0, ""
        self.clamp.rest()

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
            return self.clamp.samples(size * self._unit[places])
        start = begin.frequency if begin.amplitude else self.frequency
        turns = first + seconds * share * (start + 0.5 * share * (self.frequency - start))
        return self.clamp.samples(size * np.sin(2.0 * math.pi * np.mod(turns, 1.0)))

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
            self._peak = float(np.abs(self._unit).max()) if self._wave else 1.0
        if self._arrived and not self.waits:
            self._swept += seconds
        commanded = self.commanded
        amplitude, frequency = self.factors
        return self.clamp.point(commanded.amplitude * amplitude, commanded.frequency * frequency, self._peak)


def _toward(value: float, target: float, up: float, down: float) -> float:
    """Return `value` moved toward `target` by `up` or `down` at most."""
    return min(target, value + up) if value < target else max(target, value - down)


def unit_signal(command: Command, rate: float, recorded: Floats | None = None) -> Floats:
    """Return one period (n,) at `rate` [Hz] of noise of root mean square 1, or the recorded signal of peak 1.

    Raises CommandRefusedError where there is none.
    """
    if command.kind is ExciterKind.RANDOM:
        return noise(command.frequency, command.end_frequency, rate, command.seed)
    if recorded is None:
        raise CommandRefusedError(
            f"file: given {command.file!r}; allowed: the name of a signal that came on excitation/signal before; the "
            "output stays as it is"
        )
    return recorded


def noise(low: float, high: float, rate: float, seed: int) -> Floats:
    """Return periodic Gaussian noise (n,) at `rate` [Hz], flat between `low` and `high` [Hz], root mean square 1."""
    count = round(_NOISE_PERIOD * rate)
    lines = np.fft.rfftfreq(count, 1.0 / rate)
    inside = (lines >= low) & (lines <= high)
    if not inside.any() or high >= 0.5 * rate:
        raise CommandRefusedError(
            f"noise from {low:g} to {high:g} Hz; allowed: a band of at least {1.0 / _NOISE_PERIOD:g} Hz below half of "
            f"the output's rate, {0.5 * rate:g} Hz"
        )
    draws = np.random.default_rng(seed).standard_normal((2, int(inside.sum())))
    spectrum = np.zeros(len(lines), dtype=complex)
    spectrum[inside] = draws[0] + 1j * draws[1]
    values = np.fft.irfft(spectrum, count)
    return np.asarray(values / np.sqrt(np.mean(values**2)))
