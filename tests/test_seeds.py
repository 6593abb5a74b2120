# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The adaptive loop without the graph: the reductions of Fig. 4.8, rumble, drift, and how fast a step is identified."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from graph_runs import in_lockstep, scene_file

from atpid_control.selection.map_cache import map_for
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene
from studies.cli import main
from studies.pure_loop import run_loop
from studies.seeds.measure import configured, longest_rumble, measured, noisy, run_seed

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


@pytest.mark.slow
@pytest.mark.parametrize(("method", "least"), [("pca", 0.76), ("direct", 0.76)])
def test_the_methods_that_compute_reach_it_as_well(scenes: Path, height_map: Path, method: str, least: float) -> None:
    scene = load_scene(scenes / "stepped_4_8.yaml")
    scene = scene.with_(ceiling=scene.ceiling.model_dump(mode="json", exclude_none=True) | {"controller": method})
    stages = list(measured(run_loop(noisy(scene, 1, 40.0), configured()), HeightMap.load(height_map)))
    assert min(stage.efficiency for stage in stages) >= least


def test_the_thesis_bench_keeps_its_heights_and_amplitudes(scenes: Path, height_map: Path) -> None:
    ran = run_seed(scenes / "thesis_4_3.yaml", 1, configured(), None, height_map)
    assert [stage.height for stage in ran.stages] == pytest.approx([0.29, 0.76, 0.57], rel=0.05)
    assert max(1.0 - stage.efficiency for stage in ran.stages) <= 0.24
    assert (ran.step_backs, ran.drifts) == (0, 0)


def test_two_periods_after_a_step_the_amplitude_is_within_one_per_cent(scenes: Path, height_map: Path) -> None:
    """With noise of 40 dB below the signal; with less it holds all the more."""
    scene = load_scene(scenes / "stepped_4_8.yaml")
    ran = run_loop(noisy(scene, 3, 40.0), configured(), height_map)
    time = np.array(ran.time)
    amplitude = np.array([estimate.amplitude for estimate in ran.estimates])
    for begin, end, true in ((0.2, 8.0, 0.03), (8.2, 15.0, 0.02), (15.2, 22.0, 0.01)):
        due = (time >= begin + 2.0 / scene.frequency_hz) & (time <= end)
        assert amplitude[due] == pytest.approx(np.full(due.sum(), true), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("too_high", "kinds"), [(1.0, set()), (1.1, {"step_back"})])
def test_the_loop_without_the_graph_decides_as_the_graph_does(
    scenes: Path, height_map: Path, tmp_path: Path, too_high: float, kinds: set[str]
) -> None:
    good = HeightMap.load(height_map)
    replace(good, heights=too_high * good.heights).save(tmp_path / "map.npz")
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup", "map": "map.npz"}
    changes = {"duration": 8.0, "steady_window": [7.0, 8.0], "ceiling": ceiling}
    path = scene_file(scenes / "stepped_4_8.yaml", tmp_path, **changes)
    bag = in_lockstep(path, tmp_path / "run")
    ran = run_loop(load_scene(path), configured(), tmp_path / "map.npz")
    sent = [message.height for _, message in bag.messages("/ceiling/command")]
    assert [answer.command.height for answer in ran.answers] == pytest.approx(sent, rel=1e-12, nan_ok=True)
    beam = np.concatenate([message.beam for _, message in bag.messages("/plant/truth")])
    assert np.max(np.abs(ran.beam - beam)) <= 1e-9
    reported = [event.kind for _, event in bag.messages("/events") if event.node == "selector_node"]
    assert reported == [answer.kind for answer in ran.answers if answer.kind]
    assert set(reported) == kinds


def test_a_map_that_lies_too_high_is_left_and_not_returned_to(scenes: Path, height_map: Path, tmp_path: Path) -> None:
    good = HeightMap.load(height_map)
    replace(good, heights=1.1 * good.heights).save(tmp_path / "high.npz")
    scene = load_scene(scenes / "stepped_4_8.yaml").with_(duration=8.0, steady_window=[6.0, 8.0])
    ran = run_loop(scene, configured(), tmp_path / "high.npz")
    steps = ran.events("step_back")
    assert steps
    after = [answer.command.height for t, answer in zip(ran.time, ran.answers, strict=True) if t >= steps[0][0]]
    assert max(after) < 1.1 * good.lookup(0.03, 0.1).height
    assert all(later <= earlier for earlier, later in pairwise(after))
    # the bench's own measure sees the rumble as well
    assert longest_rumble(ran, (0.2, 8.0), good.lookup(0.03, 0.1)) > 1.0


def test_a_grain_lighter_than_modelled_is_reported_as_drift_once(scenes: Path, height_map: Path) -> None:
    believed = load_scene(scenes / "thesis_4_3.yaml")
    real = believed.with_(grain={"mass_fraction": 0.085, "radius": 0.0085}, frequency=believed.frequency_hz)
    ran = run_loop(real, configured(), height_map, model=believed)
    drifts = ran.events("drift")
    assert len(drifts) == 1
    assert "above the model's" in drifts[0][1]
    assert drifts[0][0] < 6.0  # in the first stage
    assert {answer.severity for answer in ran.answers if answer.kind == "drift"} == {2}


@pytest.mark.slow
def test_the_command_prints_its_table_and_refuses_what_it_cannot_run(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["seeds", str(scenes / "stepped_4_8.yaml"), "--seeds", "1", "--decibels", "40"]) == 0
    assert "stepped_4_8" in capsys.readouterr().out
    assert main(["seeds", str(scenes / "standard.yaml"), "--seeds", "1"]) == 2
    assert "controller" in capsys.readouterr().err
    assert main(["seeds", str(scenes / "stepped_4_8.yaml"), "--seeds", "0"]) == 2
    assert "--seeds: given 0" in capsys.readouterr().err
