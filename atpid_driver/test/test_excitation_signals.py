# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an exciter puts out: ramps, phase, spectra, limits. Judged by scipy, and by quadrature of the frequency."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_driver.excitation.settings import ExcitationSettings
from atpid_driver.excitation.signals import OFF, Command, CommandRefusedError, Generator

RATE = 1000.0
SETTINGS = ExcitationSettings(
    backend="nidaqmx", calibration="none.yaml", highest_amplitude=0.02, lowest_frequency=0.5, highest_frequency=200.0,
    rise_time=1.0, frequency_rate=2.0, stop_time=0.1, sample_rate=RATE,
)  # fmt: skip


def mode_of(generator: Generator) -> ExciterMode:
    return generator.mode


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
        kind = random.choice(["sine", "sweep", "off"])
        f = random.uniform(2.0, 8.0)
        end = random.uniform(2.0, 8.0)
        amplitude = random.uniform(0.0, 0.02)
        command = {
            "sine": Command(ExciterKind.SINE, amplitude, f, sequence=number),
            "sweep": Command(ExciterKind.SWEEP, amplitude, f, end, 4.0, sequence=number),
            "off": OFF,
        }[kind]
        generator.follow(command)
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
    command = Command(ExciterKind.RANDOM, 0.005, 10.0, 40.0, seed=seed)
    generator.follow(command)
    for _ in range(100):
        generator.samples(10)
    u = np.concatenate([generator.samples(500) for _ in range(120)])  # one period of it
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.005, rel=1e-9)
    lines, density = signal.welch(u, RATE, nperseg=2000, detrend=False)
    inside, outside = (lines > 12) & (lines < 38), (lines < 8) | (lines > 42)
    assert np.mean(density[inside]) == pytest.approx(0.005**2 / 30.0, rel=0.1)
    assert density[outside].max() < 1e-4 * density[inside].mean()
    other = Generator(SETTINGS)
    other.follow(Command(ExciterKind.RANDOM, 0.005, 10.0, 40.0, seed=seed))
    third = Generator(SETTINGS)
    third.follow(command)
    assert (other.samples(100) == third.samples(100)).all()


def test_a_recorded_signal_is_put_out_at_its_own_times_scaled_to_the_peak(tmp_path: Path) -> None:
    t = np.arange(0.0, 2.0, 1 / 256)
    values = 3.0 + 7.0 * np.sin(2 * np.pi * 2.0 * t)
    path = tmp_path / "record.csv"
    path.write_text("time,value\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(t, values, strict=True)))
    generator = Generator(SETTINGS)
    generator.follow(Command(ExciterKind.RECORDED, 0.01, file=str(path)))
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
    ("command", "word"),
    [
        (sine(amplitude=0.03), "amplitude: given 0.03; allowed: 0 to 0.02"),
        (sine(amplitude=math.nan), "amplitude: given nan"),
        (sine(frequency=0.1), "frequency: given 0.1; allowed: 0.5 to 200 Hz"),
        (Command(ExciterKind.SWEEP, 0.01, 4.0, 6.0, 0.5), "duration: given 0.5; allowed: at least 1 s"),
        (Command(ExciterKind.SWEEP, 0.01, 4.0, math.nan, 5.0), "end_frequency: given nan"),
        (Command(ExciterKind.RANDOM, 0.01, 40.0, 10.0), "end_frequency: given 10"),
        (Command(ExciterKind.RECORDED, 0.01, file="/nowhere/x.csv"), "file: given '/nowhere/x.csv'"),
    ],
)
def test_what_may_not_be_put_out_is_refused_in_one_line_and_changes_nothing(command: Command, word: str) -> None:
    generator = Generator(SETTINGS)
    generator.follow(sine())
    with pytest.raises(CommandRefusedError) as error:
        generator.follow(command)
    assert word in str(error.value)
    assert "\n" not in str(error.value)
    assert generator.command == sine()
