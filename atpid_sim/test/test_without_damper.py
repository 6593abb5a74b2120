# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The structure as it is without the damper: its own mass alone on the moving support."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_sim.modal import bare_amplitude
from atpid_sim.scene import load_scene
from atpid_sim.simulation.integration import amplitude_without_damper
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.simulation.simulate import simulate

SCENE = Path(__file__).parents[2] / "scenes" / "standard.yaml"


@settings(max_examples=10)
@given(
    mass=st.floats(0.1, 60.0), frequency=st.floats(2.0, 50.0), ratio=st.floats(0.05, 0.2), detuning=st.floats(0.5, 1.5)
)
def test_the_closed_form_is_the_motion_of_an_independent_integration(
    mass: float, frequency: float, ratio: float, detuning: float
) -> None:
    own, amplitude = 2.0 * np.pi * frequency, 0.003
    stiffness, damping, omega = mass * own**2, 2.0 * ratio * own * mass, own * detuning

    def slope(t: float, state: list[float]) -> list[float]:
        support, speed = amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t)
        return [state[1], (stiffness * (support - state[0]) + damping * (speed - state[1])) / mass]

    settled = 10.0 / (ratio * own)
    times = np.linspace(settled, settled + 2.0 * np.pi / omega, 400)
    motion = solve_ivp(slope, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-8, atol=1e-12).y[0]
    found = bare_amplitude(mass, stiffness, damping, amplitude, omega / (2.0 * np.pi))
    assert found == pytest.approx(half_peak_to_peak(motion), rel=2e-4)


def test_a_run_states_its_reduction_against_the_structure_without_the_damper() -> None:
    scene = load_scene(SCENE)
    result, beam = simulate(scene, check=False), scene.beam
    expected = bare_amplitude(beam.mass, beam.stiffness, beam.damping, 0.01, scene.natural_frequency_hz)
    assert result.bare_amplitude == pytest.approx(expected, rel=1e-12)
    assert result.reduction == pytest.approx(1.0 - result.amplitude / expected, rel=1e-12)
    assert result.efficiency > result.reduction > 0.0


def test_what_is_no_constant_tone_is_simulated_without_the_damper(tmp_path: Path) -> None:
    scene = load_scene(SCENE).with_(duration=40.0, steady_window=[38.0, 40.0])
    times = np.arange(0.0, 40.01, 0.002)
    rows = np.column_stack([times, 0.01 * np.sin(2.0 * np.pi * scene.natural_frequency_hz * times)])
    np.savetxt(tmp_path / "tone.csv", rows, delimiter=",", header="t,x", comments="")
    measured = scene.with_(
        excitation={"series": {"file": str(tmp_path / "tone.csv"), "time": "t", "displacement": "x"}}
    )
    assert amplitude_without_damper(measured) == pytest.approx(amplitude_without_damper(scene), rel=1e-4)


def test_a_free_decay_has_none() -> None:
    assert np.isnan(amplitude_without_damper(load_scene(SCENE.parent / "free_decay.yaml")))
