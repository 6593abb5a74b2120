# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The slow controller in a closed loop with an identification that is late, noisy and a little wrong."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from atpid_common.vocabulary import ExciterKind, ExciterMode
from atpid_exciter.excitation.hold import Hold
from atpid_exciter.excitation.settings import Command, ExcitationSettings
from atpid_exciter.excitation.signals import Generator

STEP = 0.05  # of the loop: one estimate a block [s]
SETTINGS = ExcitationSettings(
    backend="simulated", highest_amplitude=1.0, lowest_frequency=0.1, highest_frequency=50.0, rise_time=2.0,
    frequency_rate=5.0, stop_time=0.1,
)  # fmt: skip
Plant = Callable[[float, float, float], float]  # amplitude of the support, of output, frequency and time


def run(  # noqa: PLR0913  # what is drawn at random
    command: Command, plant: Plant, seconds: float, *, window: float, late: float, noise: float, bias: float,
    slip: float = 0.0, lag: float = 0.0, seed: int = 0,
) -> np.ndarray:  # fmt: skip
    """Return (n, 4): time [s], true amplitude, true frequency [Hz] of the support, and whether `held` was stated.

    The estimate is the mean over a window that ended some time ago; lag: time constant of the support's reaction.
    """
    generator, hold, random = Generator(SETTINGS), Hold(0.01, 4.0), np.random.default_rng(seed)
    generator.follow(command)
    steps = round(window / STEP)
    past: deque[tuple[float, float]] = deque(maxlen=steps + round(late / STEP))
    rows, gain = [], 1.0
    for k in range(round(seconds / STEP)):
        out = generator.advance(STEP)
        wanted = plant(1.0, out.frequency, k * STEP)
        gain = wanted if not lag else gain + (wanted - gain) * min(1.0, STEP / lag)
        true = out.amplitude * gain, out.frequency * (1.0 - slip)
        past.append(true)
        if len(past) == past.maxlen and generator.mode is ExciterMode.RUNNING:
            mean = np.mean(list(past)[:steps], axis=0) * (1.0 + bias) * (1.0 + noise * random.standard_normal(2))
            hold.turn(generator.commanded, (mean[0], mean[1]), STEP, window + 0.2)
            generator.factors, generator.waits = hold.factors, hold.waits
        rows.append((k * STEP, *true, hold.held))
    return np.array(rows)


@pytest.mark.parametrize("seed", range(16))
def test_any_gain_is_removed_whatever_the_delay_is(seed: int) -> None:
    random = np.random.default_rng(seed)
    gain, slip = np.exp(random.uniform(np.log(0.35), np.log(2.8))), random.uniform(0.0, 0.03)
    window, late = random.uniform(0.2, 1.5), random.uniform(0.0, 0.3)
    command = Command(ExciterKind.SINE, 0.3, 5.0)
    rows = run(command, lambda one, _f, _t: gain * one, 160.0, window=window, late=late, noise=0.003,
               bias=random.uniform(-0.003, 0.003), slip=slip, lag=random.uniform(0.0, 0.5), seed=seed)  # fmt: skip
    settled = rows[rows[:, 0] > 2.0 + 60.0 * (window + 0.2)]
    assert np.abs(settled[:, 1] / 0.3 - 1.0).max() < 0.01
    assert np.abs(settled[:, 2] / 5.0 - 1.0).max() < 0.01
    assert settled[:, 3].mean() > 0.95
    # an overshoot that crosses the command is not held
    assert np.abs(rows[rows[:, 3] > 0.0, 1] / 0.3 - 1.0).max() < 0.01
    # it comes near without passing far beyond, even before
    if gain < 1.0:
        assert rows[:, 1].max() < 0.3 * 1.1


def reacting(ratio: float, frequency: float, damping: float) -> Plant:
    """Return a support that a structure of `frequency` [Hz] pulls at, as closed form: gain of drive to support."""

    def plant(one: float, f: float, _time: float) -> float:
        s = 1j * f / frequency
        carried = ratio * -(s**2) * (1.0 + 2.0 * damping * s) / (s**2 + 2.0 * damping * s + 1.0)
        return one / abs(1.0 - carried)

    return plant


@pytest.mark.parametrize("seed", range(3))
def test_a_sweep_across_resonance_is_held_within_one_per_cent(seed: int) -> None:
    """0.8 to 1.2 of resonance with a damper of 8 % on a support that gives way by up to a fifth."""
    random = np.random.default_rng(100 + seed)
    plant = reacting(random.uniform(0.01, 0.03), 5.0, 0.08)
    free = [plant(1.0, f, 0.0) for f in np.linspace(4.0, 6.0, 200)]
    assert max(free) / min(free) - 1.0 > 0.08  # it is worth a controller
    command = Command(ExciterKind.SWEEP, 0.3, 4.0, 6.0, 240.0)
    rows = run(command, plant, 500.0, window=random.uniform(0.4, 1.0), late=0.1, noise=0.001, bias=0.0, lag=0.3,
               seed=seed)  # fmt: skip
    begun = rows[:, 2] > 4.005
    assert rows[-1, 2] == pytest.approx(6.0, rel=2e-3)
    assert np.abs(rows[begun, 1] / 0.3 - 1.0).max() < 0.01


def test_what_cannot_be_reached_stays_within_the_correction_and_is_not_held() -> None:
    command = Command(ExciterKind.SINE, 0.2, 5.0)
    rows = run(command, lambda one, _f, _t: 0.1 * one, 60.0, window=0.5, late=0.1, noise=0.0, bias=0.0)
    assert rows[-1, 1] == pytest.approx(0.2 * 0.1 * 4.0, rel=1e-9)
    assert not rows[:, 3].any()


def settled(hold: Hold, measured: tuple[float, float] = (0.3, 5.0), **more: bool) -> Hold:
    for _ in range(200):
        hold.turn((0.3, 5.0), measured, STEP, 0.5, **more)
    return hold


def test_an_estimate_that_is_none_ends_what_was_held() -> None:
    for none in ((np.nan, 5.0), (0.0, 5.0), (np.inf, 5.0), (0.3, -1.0)):
        hold = settled(Hold(0.01, 3.0), none)
        assert hold.factors == (1.0, 1.0)
        assert not hold.held
        assert settled(hold).held
        hold.turn((0.3, 5.0), none, STEP, 0.5)
        assert not hold.held
        hold.turn((0.3, 5.0), (0.3, 5.0), STEP, 0.5)
        assert not hold.held  # it has to settle again
        assert settled(hold).held


def test_the_last_estimate_has_to_be_within_the_tolerance_too() -> None:
    hold = settled(Hold(0.01, 3.0))
    hold.turn((0.3, 5.0), (0.3 * 1.02, 5.0), STEP, 0.5)
    assert hold.error < 0.01
    assert not hold.held
    hold.turn((0.3, 5.0), (0.3, 5.0), STEP, 0.5)
    assert hold.held


def test_the_amplitude_of_a_disc_is_not_corrected() -> None:
    hold = settled(Hold(0.01, 3.0, fixed_amplitude=True), (0.2, 4.8))
    assert hold.factors[0] == 1.0
    assert hold.factors[1] > 1.01
    assert not hold.at_limit
    assert not hold.held


def test_at_the_limits_nothing_is_summed_up() -> None:
    hold = settled(Hold(0.01, 3.0), (0.28, 5.0))
    before = hold.factors
    assert settled(hold, (0.28, 5.0), limited=True).factors == before
    assert hold.misses
    assert settled(hold, (0.32, 5.0), limited=True).factors[0] < before[0]  # the way back is free
