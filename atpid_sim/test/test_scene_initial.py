# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Initial states: a run that is continued from its own state, a grain that is thrown, and invalid ones."""

import math
import re
from typing import Any

import numpy as np
import pytest

from atpid_sim.scene import SceneError, standard_bench
from atpid_sim.scene.scene import scene_from_mapping
from atpid_sim.simulation.simulate import simulate, trajectory

#: Samples a period of the excitation.
_SAMPLES = 400


@pytest.mark.parametrize("fidelity", ["impact", "finite", "soft"])
def test_a_run_begun_from_the_state_of_another_continues_it(fidelity: str) -> None:
    """The state after whole periods of the tone is the first one of a scene of its own."""
    scene = standard_bench(excitation={"amplitude": 0.01, "frequency": 5.0}, duration=4.0, steady_window=[3.0, 4.0])
    whole = trajectory(scene, 5.0 * _SAMPLES, fidelity, rtol=1e-9)
    in_flight = (whole.grain - whole.beam > 1e-3) & (np.arange(len(whole.time)) % _SAMPLES == 0)
    place = int(np.flatnonzero(in_flight)[1])
    # the grain's velocity from its parabola over two samples: exact but for rounding
    step = whole.time[1]
    grain_velocity = (whole.grain[place + 1] - whole.grain[place - 1]) / (2.0 * step)
    continued = scene.with_(
        initial={"displacement": float(whole.beam[place]) + scene.static_deflection,
                 "velocity": float(whole.beam_velocity[place]),
                 "grain_height": float(whole.grain[place] - whole.beam[place]), "grain_velocity": grain_velocity},
        duration=1.0, steady_window=[0.0, 1.0],
    )  # fmt: skip
    again = trajectory(continued, 5.0 * _SAMPLES, fidelity, rtol=1e-9)
    for name in ("beam", "grain", "beam_velocity"):
        expected = getattr(whole, name)[place : place + len(again.time)]
        np.testing.assert_allclose(getattr(again, name), expected, atol=1e-6 * np.abs(expected).max())


def test_a_grain_thrown_from_the_floor_flies_a_parabola() -> None:
    scene = standard_bench(ceiling={"height": 10.0}, initial={"grain_velocity": 3.0}, duration=0.3,
                           steady_window=[0.0, 0.3], excitation={"amplitude": 0.0, "frequency": 1.0})  # fmt: skip
    motion = trajectory(scene, 1000.0)
    flight = -scene.static_deflection + 3.0 * motion.time - 0.5 * 9.81 * motion.time**2
    np.testing.assert_allclose(motion.grain, flight, atol=1e-12)
    assert len(motion.impacts) == 0


def test_a_beam_begun_from_a_displacement_is_the_free_decay() -> None:
    free = standard_bench(excitation={"free": {"deflection": 0.1}}, duration=2.0, steady_window=[0.0, 2.0])
    still = free.with_(excitation={"amplitude": 0.0, "frequency": 1.0}, initial={"displacement": 0.1})
    one, other = (trajectory(scene, 500.0, "soft") for scene in (still, free))
    np.testing.assert_allclose(one.beam, other.beam, atol=1e-9)


def test_the_energy_of_a_run_begun_in_motion_is_balanced() -> None:
    initial = {"displacement": -0.02, "velocity": 0.7, "grain_height": 0.05, "grain_velocity": -2.0}
    result = simulate(standard_bench(initial=initial))
    assert abs(result.energy_residual) < 1e-5
    assert result.impacts > 50


@pytest.mark.parametrize(
    ("initial", "expected"),
    [
        ({"grain_height": 0.19}, "initial.grain_height: given 0.19; allowed: at most the clearance at the start"),
        ({"grain_height": -0.1}, "initial.grain_height: given -0.1; allowed: from 0 to 1e+06"),
        ({"velocity": 1.0, "grain_velocity": 0.5}, "initial.grain_velocity: given 0.5; allowed: at least velocity (1"),
        ({"displacment": 0.1}, "initial.displacment: unknown key; did you mean displacement?"),
        ({"velocity": "1 m/s"}, "initial.velocity: given '1 m/s'; allowed: a bare number, in m/s"),
        (
            0.1,
            "initial: given 0.1; allowed: a block with the keys displacement, velocity, grain_height, grain_velocity",
        ),
    ],
)
def test_what_cannot_be_is_one_line(initial: Any, expected: str) -> None:
    with pytest.raises(SceneError, match=re.escape(expected)):
        standard_bench(initial=initial)


def test_a_deflection_is_given_once() -> None:
    mapping = standard_bench(excitation={"free": {"deflection": 0.1}}).to_mapping() | {"initial": {"displacement": 0.1}}
    with pytest.raises(SceneError, match=r"allowed: none beside excitation\.free\.deflection"):
        scene_from_mapping(mapping)


def test_the_closed_damper_of_a_scene_whose_grain_begins_in_the_air() -> None:
    """Beam and grain as one mass: the ratio of successive peaks is that of the damped oscillator, in closed form."""
    scene = standard_bench(
        excitation={"free": {"deflection": 0.1}}, ceiling={"height": 0.2}, initial={"grain_height": 0.05}, duration=6.0,
        steady_window=[4.0, 6.0],
    )  # fmt: skip
    ratio = scene.beam.damping / (2.0 * math.sqrt(scene.beam.stiffness * scene.total_mass))
    expected = math.exp(2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2))
    assert simulate(scene, check=False).undamped_decrement == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("ceiling", [{"height": 0.017}, {"closed": 0.017, "open": 0.2, "start": 1.0, "end": 2.0}])
def test_under_a_closed_ceiling_the_grain_begins_on_the_floor(ceiling: dict[str, float]) -> None:
    start = {"displacement": 0.01, "grain_height": 0.05, "grain_velocity": 1.0}
    scene = standard_bench(ceiling={"height": 0.2}, initial=start)
    assert scene.with_(ceiling=ceiling).to_mapping()["initial"] == {"displacement": 0.01}
    with pytest.raises(SceneError, match=r"grain_height: given 0.05; allowed: at most the clearance"):
        scene.with_(height=0.05)
