# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The adaptive loop without the graph: the reductions of Fig. 4.8, rumble, drift, and how fast a step is identified."""

from pathlib import Path

import numpy as np
import pytest

from atpid_control.selection.map_cache import map_for
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene
from studies.pure_loop import run_loop
from studies.seeds.measure import configured, measured, noisy, run_seed

# brute force allows 79.5, 85 and 86.9 % at 0.01 m
STEPPED = [("stepped_4_8", 0.76), ("stepped_4_8_phi_0_2", 0.82), ("stepped_4_8_phi_0_3", 0.86)]


@pytest.fixture(scope="module")
def height_map(scenes: Path) -> Path:
    shipped = map_for(load_scene(scenes / "stepped_4_8.yaml"))
    assert shipped is not None
    return shipped


@pytest.mark.parametrize(("name", "least", "seed"), [(*one, 1) for one in STEPPED] + [(*STEPPED[0], 2)])
def test_stepped_excitation_is_reduced_in_every_stage_without_rumble(
    scenes: Path, height_map: Path, name: str, least: float, seed: int
) -> None:
    ran = run_seed(scenes / f"{name}.yaml", seed, configured(), 40.0, height_map)
    assert [stage.excitation_amplitude for stage in ran.stages] == [0.03, 0.02, 0.01]
    assert min(stage.efficiency for stage in ran.stages) >= least
    assert (ran.step_backs, ran.drifts) == (0, 0)
    if name == "stepped_4_8":
        assert max(stage.rumble for stage in ran.stages) <= 1.0


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_the_methods_that_compute_reach_it_as_well(scenes: Path, height_map: Path, method: str) -> None:
    scene = load_scene(scenes / "stepped_4_8.yaml")
    scene = scene.with_(ceiling=scene.ceiling.model_dump(mode="json", exclude_none=True) | {"controller": method})
    stages = list(measured(run_loop(noisy(scene, 1, 40.0), configured()), HeightMap.load(height_map)))
    assert min(stage.efficiency for stage in stages) >= STEPPED[0][1]


def test_two_periods_after_a_step_the_amplitude_is_within_one_per_cent(scenes: Path, height_map: Path) -> None:
    """With noise of 40 dB below the signal; with less it holds all the more."""
    scene = load_scene(scenes / "stepped_4_8.yaml")
    ran = run_loop(noisy(scene, 3, 40.0), configured(), height_map)
    time = np.array(ran.time)
    amplitude = np.array([estimate.amplitude for estimate in ran.estimates])
    for begin, end, true in ((0.2, 8.0, 0.03), (8.2, 15.0, 0.02), (15.2, 22.0, 0.01)):
        due = (time >= begin + 2.0 / scene.frequency_hz) & (time <= end)
        assert amplitude[due] == pytest.approx(np.full(due.sum(), true), rel=0.01)


def test_a_grain_lighter_than_modelled_is_reported_as_drift_once(scenes: Path, height_map: Path) -> None:
    believed = load_scene(scenes / "thesis_4_3.yaml")
    real = believed.with_(grain={"mass_fraction": 0.085, "radius": 0.0085}, frequency=believed.frequency_hz)
    ran = run_loop(real, configured(), height_map, model=believed)
    ((at, text),) = ran.events("drift")
    assert at < 6.0  # in the first stage
    assert "above" in text.split()
    assert {answer.severity for answer in ran.answers if answer.kind == "drift"} == {2}
