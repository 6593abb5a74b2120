# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The thesis's figures, tables and measurements without any fitting; docs/research/measured.md prints them all."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.simulate import simulate, trajectory
from studies.thorough_search import thorough_best

SCENES = Path(__file__).parents[1] / "scenes"

#: Section 2.3.1, measured on the stand: mass fraction, height [m], largest ratio of successive amplitudes, tolerance.
DECREMENTS = [
    (0.1, 0.017, 1.31, 0.01),
    (0.025, 0.05, 1.345, 0.03),
    (0.025, 0.10, 1.38, 0.03),
    (0.025, 0.15, 1.40, 0.03),
    (0.025, 0.20, 1.42, 0.03),
    (0.05, 0.20, 1.52, 0.03),
    (0.1, 0.20, 1.8, 0.05),
    (0.2, 0.20, 2.5, 0.05),
]

#: Likewise, ceiling at 0.2 m, released from other deflections: mass fraction, deflection [m], measured, model. The
#: model misses both; that it still gives what is printed is all that is tested.
MISSED = [(0.3, 0.1, 12.0, 1.8), (0.2, 0.15, 3.0, 2.5)]

#: Table 3.7, measured at the best height: mass fraction, support amplitude [m], efficiency [%], and the model's.
TABLE_3_7 = [(0.3, 0.03, 91.4, 90.4), (0.3, 0.02, 91.3, 89.6), (0.2, 0.03, 90.8, 89.1), (0.2, 0.02, 88.7, 85.8)]

#: Section 2.3.2, measured: excitation over resonance, about what efficiency [%], and the model's.
AROUND_RESONANCE = [(0.95, 30.0, 30.0), (1.0, 50.0, 55.0), (1.05, 40.0, 35.0)]

#: Fig. 3.11 and section 3.5.1: height [m], reduction of the amplitude [%], as a converged reference computes them.
REDUCTIONS = [(0.04, 9.0), (0.08, 35.0), (0.12, 59.0), (0.16, 71.0), (0.20, 79.0)]


def standard(**changes: Any) -> Scene:
    return load_scene(SCENES / "standard.yaml").with_(**changes)


def released(phi: float, **changes: Any) -> Scene:
    return load_scene(SCENES / "free_decay.yaml").with_(mass_fraction=phi, **changes)


def largest_decrement(scene: Scene) -> float:
    """Largest ratio of successive upper peaks above the static equilibrium, as long as they exceed 2 mm."""
    motion = trajectory(scene, 5000.0)
    v = motion.beam_velocity
    tops = np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))
    # between two samples the velocity falls almost straight to zero
    share = v[tops] / (v[tops] - v[tops + 1])
    peaks = motion.beam[tops] + 0.5 * v[tops] * share / 5000.0 + scene.static_deflection
    peaks = peaks[peaks > 0.002]
    return float(np.max(peaks[:-1] / peaks[1:]))


@pytest.mark.parametrize(("phi", "height", "measured", "tolerance"), DECREMENTS)
def test_decrements_measured_on_the_real_stand(phi: float, height: float, measured: float, tolerance: float) -> None:
    assert largest_decrement(released(phi, height=height, duration=8.0)) == pytest.approx(measured, rel=tolerance)


def test_a_heavy_grain_stops_the_free_beam_at_once() -> None:
    assert largest_decrement(released(0.3, duration=8.0)) > 3.0


@pytest.mark.parametrize(("phi", "deflection", "measured", "model"), MISSED)
def test_decays_decided_by_one_impact_are_missed(phi: float, deflection: float, measured: float, model: float) -> None:
    result = simulate(released(phi, excitation={"free": {"deflection": deflection}}), check=False)
    assert result.decrement == pytest.approx(model, abs=0.05)
    assert result.decrement < 0.9 * measured


@pytest.mark.parametrize(("phi", "amplitude", "measured", "model"), TABLE_3_7)
def test_efficiencies_measured_at_the_best_height(phi: float, amplitude: float, measured: float, model: float) -> None:
    best = thorough_best(DamperResponse(standard(mass_fraction=phi), 1e-5), amplitude)
    assert 100.0 * best.efficiency == pytest.approx(measured, abs=3.0)
    assert 100.0 * best.efficiency == pytest.approx(model, abs=0.2)


@pytest.mark.parametrize(("ratio", "measured", "model"), AROUND_RESONANCE)
def test_efficiencies_measured_around_the_resonance(ratio: float, measured: float, model: float) -> None:
    scene = standard(beam={"mass": 0.3258, "stiffness": 117.6, "damping": 0.56}, mass_fraction=0.2)
    scene = scene.with_(frequency=ratio * scene.natural_frequency_hz, duration=30.0, steady_window=[25.0, 30.0])
    result = simulate(scene)
    assert result.reproducible
    assert 100.0 * result.efficiency == pytest.approx(model, abs=0.6)
    assert 100.0 * result.efficiency == pytest.approx(measured, abs=6.0)


@pytest.mark.parametrize(("height", "reduction"), REDUCTIONS)
def test_reductions_of_the_standard_bench(height: float, reduction: float) -> None:
    result = simulate(standard(height=height))
    assert 100.0 * result.efficiency == pytest.approx(reduction, abs=1.0)
    assert result.reproducible
    assert abs(result.energy_residual) <= 1e-6


def test_the_standard_task_to_eight_digits() -> None:
    # half the distance between the true turning points, which LSODA at 1e-11 and Cash-Karp at 1e-12 agree on
    result = simulate(standard(), fidelity="soft", rtol=1e-10)
    assert result.amplitude == pytest.approx(0.0456498937, abs=1e-10)


def test_natural_frequencies() -> None:
    scene = standard()
    assert scene.frequency_hz == pytest.approx(5.469, abs=1e-3)
    open_frequency = np.sqrt(scene.beam.stiffness / scene.beam.mass) / (2.0 * np.pi)
    assert open_frequency == pytest.approx(5.77, abs=0.01)
