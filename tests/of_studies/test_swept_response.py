# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The response to a sweep or a shock by local models, against the closed form."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_signals import RATE, noise, tone

from atpid_control.analysis import AnalysisError, Signals, analyse, frequency_response
from atpid_control.analysis.local_response import passes_once
from atpid_sim.scene import scene_from_mapping
from atpid_sim.simulation.simulate import trajectory
from studies.time_base import sweep_held

SWEPT = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56}, "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"sweep": {"amplitude": 0.002, "from": 4.0, "to": 7.0}}, "ceiling": {"height": 0.017},
    "gravity": 9.81, "duration": 60.0, "steady_window": [50.0, 60.0], "tolerance": 1e-5,
    "seed": 1,
}  # fmt: skip


@pytest.mark.slow
def test_the_intervals_of_sweeps_hold_the_closed_form() -> None:
    random = np.random.default_rng(8)
    size, phase, peaks = zip(*(sweep_held(random, 60.0, 1e-4) for _ in range(25)), strict=True)
    assert 0.92 < np.mean([held.mean() for held in size]) <= 1.0
    assert 0.92 < np.mean([held.mean() for held in phase]) <= 1.0
    assert max(peaks) < 0.01


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31))
def test_without_noise_one_mode_is_exact(seed: int) -> None:
    assert sweep_held(np.random.default_rng(seed), 40.0, 0.0)[2] < 1e-4


def test_a_simulated_sweep_with_the_damper_closed_has_the_closed_form() -> None:
    """Beam and grain are one mass, but for what the contacts that hold the grain yield."""
    scene, random = scene_from_mapping(SWEPT, source="test"), np.random.default_rng(4)
    motion = trajectory(scene, RATE)
    support, beam = (one + random.normal(0.0, 2e-5, len(one)) for one in (motion.support, motion.beam))
    found = analyse(Signals(RATE, support, beam)).response
    assert found is not None
    assert found.local is not None
    lines = found.trusted & (found.frequency > 4.2) & (found.frequency < 6.8)
    omega = 2j * math.pi * found.frequency[lines]
    off = found.h1[lines] * (scene.total_mass * omega**2 + 0.56 * omega + 427.6) / (0.56 * omega + 427.6)
    width = 1.96 * np.hypot(found.relative_std[lines], 5e-4)
    assert np.mean(np.abs(np.abs(off) - 1.0) < width) > 0.9
    assert np.mean(np.abs(np.angle(off)) < width) > 0.9


def test_a_sweep_and_a_shock_pass_once_and_what_repeats_does_not() -> None:
    time = np.arange(60_000) / RATE
    sweep = np.sin(2.0 * math.pi * (4.0 * time + 0.02 * time**2))
    shock = np.where(time < 0.02, 1.0, 0.0) + noise(60_000, 1, 1e-4)
    steps = tone(5.0, 1.0, 60.0) * np.where(time < 30.0, 1.0, 2.0)
    assert [passes_once(one) for one in (sweep, shock)] == [True, True]
    assert [passes_once(one) for one in (steps, noise(60_000, 2), tone(5.0, 1.0, 60.0))] == [False] * 3


def test_a_gap_leaves_its_longest_part_and_is_named() -> None:
    time = np.arange(60_000) / RATE
    sweep = np.sin(2.0 * math.pi * (4.0 * time + 0.02 * time**2))
    sweep[9000:9100] = np.nan
    found = frequency_response(Signals(RATE, sweep, 2.0 * sweep + noise(60_000, 3, 1e-3)))
    assert any("9100 samples beside the longest part" in line for line in found.doubts)
    assert np.all(np.abs(np.abs(found.h1) / 2.0 - 1.0)[found.trusted] < 5.0 * found.relative_std[found.trusted])
    with pytest.raises(AnalysisError, match="no excitation"):
        frequency_response(Signals(RATE, np.zeros(60_000), sweep), window="local")
