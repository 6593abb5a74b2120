# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an exciter puts out: ramps, phase, spectra, limits. Judged by scipy, and by quadrature of the frequency."""

import math
import os
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from atpid_common.files import FileError
from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_exciter.excitation.settings import (
    OFF,
    Clamp,
    Command,
    CommandRefusedError,
    ExcitationSettings,
    SignalError,
    check_unit,
)
from atpid_exciter.excitation.signals import MOST_SAMPLES, Generator, read_recorded, resampled, scaled, unit_signal

RATE = 1000.0
mode_of = attrgetter("mode")
SETTINGS = ExcitationSettings(
    backend="nidaqmx", calibration="none.yaml", highest_amplitude=0.02, lowest_frequency=0.5, highest_frequency=200.0,
    rise_time=1.0, frequency_rate=2.0, stop_time=0.1, sample_rate=RATE,
)  # fmt: skip


def sine(amplitude: float = 0.01, frequency: float = 5.0, **more: object) -> Command:
    return Command(ExciterKind.SINE, amplitude, frequency, **more)  # type: ignore[arg-type]


def piecewise(generator: Generator, random: np.random.Generator, count: int) -> np.ndarray:
    """Return the next samples (count,), taken in pieces of random length."""
    taken: list[np.ndarray] = []
    while sum(map(len, taken)) < count:
        taken.append(generator.samples(int(random.integers(1, 40))))
    return np.concatenate(taken)


@pytest.mark.parametrize("seed", range(20))
def test_any_commands_give_a_motion_without_a_jump(seed: int) -> None:
    random, generator = np.random.default_rng(seed), Generator(SETTINGS)
    values = []
    for number in range(12):
        amplitude, (f, end) = random.uniform(0.0, 0.02), random.uniform(2.0, 8.0, 2)
        tone = Command(ExciterKind.SINE, amplitude, f, sequence=number)
        sweep = Command(ExciterKind.SWEEP, amplitude, f, end, 4.0, sequence=number)
        generator.follow((tone, sweep, OFF)[random.integers(3)])
        values.append(piecewise(generator, random, int(random.integers(50, 3000))))
    u = np.concatenate(values)
    fastest = 2 * math.pi * 8.0
    # a stop takes 0.1 s: the amplitude's own slope adds to the velocity
    assert np.abs(np.diff(u)).max() * RATE < 0.02 * (fastest + 1.0 / SETTINGS.stop_time) * 1.01
    assert np.abs(u).max() <= 0.02


def test_a_tone_is_exact_and_ramps_take_the_time_they_are_given() -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    u = piecewise(generator, np.random.default_rng(0), 4000)[:4000]
    t = np.arange(1, 4001) / RATE
    assert np.abs(u - 0.01 * np.minimum(1.0, t / 0.5) * np.sin(2 * np.pi * 5.0 * t)).max() < 1e-5  # a kink in a piece
    assert np.abs(u[1000:] - 0.01 * np.sin(2 * np.pi * 5.0 * t[1000:])).max() < 1e-12
    assert mode_of(generator) is ExciterMode.RUNNING
    generator.stop()
    assert mode_of(generator) is ExciterMode.STOPPING
    rest = np.concatenate([generator.samples(10) for _ in range(12)])
    assert (rest[101:] == 0.0).all()
    assert mode_of(generator) is ExciterMode.OFF


def test_a_change_of_frequency_keeps_the_phase_and_its_rate() -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    before = np.concatenate([generator.samples(10) for _ in range(200)])
    generator.follow(sine(frequency=6.0))
    assert mode_of(generator) is ExciterMode.RAMPING
    after = np.concatenate([generator.samples(10) for _ in range(200)])
    t = np.arange(1, 4001) / RATE
    f = np.interp(t, [2.0, 2.5], [5.0, 6.0])
    turns = np.cumsum(f + np.concatenate([[5.0], f[:-1]])) / (2.0 * RATE)
    assert np.abs(np.concatenate([before, after])[1000:] - 0.01 * np.sin(2 * np.pi * turns)[1000:]).max() < 1e-9
    assert mode_of(generator) is ExciterMode.RUNNING


def test_a_sweep_goes_from_end_to_end_in_its_time_and_waits_where_told() -> None:
    generator = Generator(SETTINGS)
    generator.follow(Command(ExciterKind.SWEEP, 0.01, 4.0, 6.0, 10.0))
    seen = [generator.advance(0.05).frequency for _ in range(400)]
    begun = next(k for k, f in enumerate(seen) if f > 4.0)
    ended = next(k for k, f in enumerate(seen) if f == 6.0)
    assert 0.05 * (ended - begun) == pytest.approx(10.0, abs=0.11)
    assert seen[-1] == 6.0
    again = Generator(SETTINGS)
    again.follow(Command(ExciterKind.SWEEP, 0.01, 4.0, 6.0, 10.0))
    again.waits = True
    assert {again.advance(0.05).frequency for _ in range(400)} == {4.0}


@pytest.mark.parametrize("seed", range(3))
def test_noise_has_its_own_spectrum_size_and_seed(seed: int) -> None:
    generator = Generator(SETTINGS)
    command = Command(ExciterKind.RANDOM, 0.004, 10.0, 40.0, seed=seed)
    generator.follow(command)
    for _ in range(100):
        generator.samples(10)
    u = np.concatenate([generator.samples(500) for _ in range(120)])  # one period of it
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.004, rel=1e-9)
    lines, density = signal.welch(u, RATE, nperseg=2000, detrend=False)
    inside, outside = (lines > 12) & (lines < 38), (lines < 8) | (lines > 42)
    assert np.mean(density[inside]) == pytest.approx(0.004**2 / 30.0, rel=0.1)
    assert density[outside].max() < 1e-4 * density[inside].mean()
    one, other = Generator(SETTINGS), Generator(SETTINGS)
    one.follow(command)
    other.follow(replace(command))
    assert (one.samples(100) == other.samples(100)).all()


def test_a_recorded_signal_is_put_out_at_its_own_times_scaled_to_the_peak(tmp_path: Path) -> None:
    t = np.arange(0.0, 2.0, 1 / 256)
    values = 3.0 + 7.0 * np.sin(2 * np.pi * 2.0 * t)
    path = tmp_path / "record.csv"
    path.write_text("time,value\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(t, values, strict=True)))
    generator = Generator(SETTINGS)
    rate, recording = read_recorded(path)
    generator.follow(Command(ExciterKind.RECORDED, 0.01, file=path.name), resampled(recording, rate, RATE))
    generator.samples(1000)
    u = generator.samples(2000)
    assert np.abs(u).max() == pytest.approx(0.01, rel=2e-3)
    spectrum = np.abs(np.fft.rfft(u))
    assert np.fft.rfftfreq(2000, 1 / RATE)[spectrum.argmax()] == pytest.approx(2.0, abs=0.3)


def test_another_form_of_signal_begins_from_nothing() -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    for _ in range(100):
        generator.samples(10)
    generator.follow(Command(ExciterKind.RANDOM, 0.001, 10.0, 40.0))
    sizes = []
    for _ in range(200):
        generator.samples(10)
        sizes.append(generator.amplitude)
    assert min(sizes) == 0.0
    assert sizes[-1] == 0.001


@pytest.mark.parametrize(
    ("command", "parts"),
    [
        (sine(amplitude=0.03), r"amplitude.* 0\.03;.* 0 to 0\.02"),
        (sine(amplitude=math.nan), r"amplitude.* nan"),
        (sine(frequency=0.1), r"frequency.* 0\.1;.* 0\.5 to 200 Hz"),
        (Command(ExciterKind.SWEEP, 0.01, 4.0, 6.0, 0.5), r"duration.* 0\.5;.* 1 s"),
        (Command(ExciterKind.SWEEP, 0.01, 4.0, math.nan, 5.0), r"end_frequency.* nan"),
        (Command(ExciterKind.RANDOM, 0.01, 40.0, 10.0), r"end_frequency.* 10"),
        (Command(ExciterKind.RECORDED, 0.01, file="/nowhere/x.csv"), r"file.*'/nowhere/x\.csv'"),
        (Command(ExciterKind.RANDOM, 0.02, 10.0, 40.0), r"amplitude.* 0\.02;.* 0\.00528"),
        (Command(ExciterKind.RANDOM, 0.001, 10.0, 40.0, hold=True), r"hold.*RANDOM;.*SINE.*SWEEP"),
    ],
)
def test_what_may_not_be_put_out_is_refused_in_one_line_and_changes_nothing(command: Command, parts: str) -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    with pytest.raises(CommandRefusedError, match=f"^.*{parts}.*$"):
        generator.follow(command)
    assert generator.command == sine()


@pytest.mark.parametrize("seed", range(20))
def test_no_correction_takes_the_output_beyond_its_limits(seed: int) -> None:
    """Neither amplitude nor frequency; a tone's samples are judged by their own size and rate of change."""
    random, generator = np.random.default_rng(seed), Generator(SETTINGS)
    factors = np.exp(random.uniform(-2.0, 2.0, (20, 2)))
    kind = random.choice(["sine", "noise"])
    command = sine(0.02, 150.0) if kind == "sine" else Command(ExciterKind.RANDOM, 0.004, 10.0, 150.0, seed=seed)
    peak = 1.0 if kind == "sine" else np.abs(unit_signal(command, RATE)).max()
    generator.follow(command)
    for factor in factors:
        generator.correct(factor[0], factor[1], waits=False)
        u = piecewise(generator, random, 500)
        assert np.abs(u).max() <= 0.02
        assert generator.frequency <= 200.0
        assert generator.amplitude * peak <= 0.02 * (1 + 1e-12)
        wanted = factor[0] * command.amplitude * peak
        beyond = wanted > 0.02 * (1 + 1e-9) or (kind == "sine" and not 0.5 <= 150.0 * factor[1] <= 200.0)
        assert generator.clamp.limited == beyond
    generator.stop()
    assert not generator.clamp.limited


def test_the_clamp_limits_peak_and_rate_of_change_of_any_samples_and_refuses_what_is_none() -> None:
    clamp = Clamp(SETTINGS)
    step = 0.02 * (2 * math.pi * 200.0 + 1.0 / 0.1) / RATE  # at the largest amplitude and frequency, while it stops
    assert clamp.samples(np.array([0.001, -0.001])) == pytest.approx([0.001, -0.001])
    assert not clamp.limited
    assert clamp.samples(np.full(3, 1.0)) == pytest.approx([min(0.02, -0.001 + step), 0.02, 0.02])
    assert clamp.limited
    fast = Clamp(replace(SETTINGS, highest_frequency=1.0))
    out = fast.samples(np.array([1.0, -1.0, 1.0, 1.0]))
    assert np.abs(np.diff(out, prepend=0.0)).max() == pytest.approx(0.02 * (2 * math.pi + 10.0) / RATE)
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(SignalError):
            clamp.samples(np.array([0.0, value]))


def test_a_signal_whose_peak_or_rate_of_change_is_beyond_the_limits_is_refused() -> None:
    check_unit(SETTINGS, sine(0.02), np.sin(2 * np.pi * 200.0 * np.arange(1000) / RATE))
    with pytest.raises(CommandRefusedError, match=r"amplitude.* 0\.02;.* 0\.01,"):
        check_unit(SETTINGS, sine(0.02), np.array([0.0, 0.1, 2.0, 0.1]))
    slow = replace(SETTINGS, highest_frequency=10.0)
    with pytest.raises(CommandRefusedError, match=r"amplitude.* 0\.02;.* 0\.0182"):
        check_unit(slow, sine(0.02), np.sin(2 * np.pi * 11.0 * np.arange(1000) / RATE))


def test_one_that_has_ended_by_itself_follows_nothing_until_it_was_switched_off() -> None:
    generator = Generator(SETTINGS)
    generator.end("nothing runs")
    assert not generator.ended
    generator.follow(sine())
    generator.advance(2.0)
    generator.end("silent")
    for number in range(3):
        generator.follow(sine(sequence=number))
        generator.advance(0.1)
    assert (generator.amplitude, mode_of(generator), generator.ended) == (0.0, ExciterMode.OFF, "silent")
    generator.cut()
    generator.follow(sine())
    assert generator.advance(1.0).amplitude == 0.01


def test_a_file_that_is_no_bounded_signal_is_refused_in_one_line_by_who_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "signal.txt"
    for text in (
        "0 0\n1 1\n1e12 0", "0 0\n1 1\n2e5 0", "0 0\n0 1\n1 0", "0 0\n1 nan\n2 0", "0 0\n1e-9 1\n2 0",
        "1 2 3\n2 3 4", "0 1\n1 1\n2 1", "", "words", "0 0\n-1 1",
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(FileError, match=r"^.*signal\.txt.*$"):
            read_recorded(path)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):  # what is no file is not opened
        with pytest.raises(FileError):
            read_recorded(path)


def test_samples_that_are_no_signal_are_refused_by_the_node_too() -> None:
    for values, rate in (
        ([0.0, math.nan], 1.0), ([0.0, math.inf], 1.0), ([], 1.0), ([1.0, 1.0], 1.0), ([0.0, 1.0], 1e-3),
        (np.zeros(MOST_SAMPLES + 1), 1e6),
    ):  # fmt: skip
        with pytest.raises(CommandRefusedError):
            resampled(np.array(values), rate, RATE)
    # the largest numbers have a mean and a peak
    assert scaled(np.array([0.0, 1e308, -1e308])) == pytest.approx([0.0, 1.0, -1.0])


def test_a_stop_that_is_repeated_takes_no_longer() -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    generator.advance(1.0)
    for _ in range(10):
        generator.stop()
        generator.advance(0.011)
    assert mode_of(generator) is ExciterMode.OFF
