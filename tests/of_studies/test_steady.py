# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions without waiting, at one height and over heights: against runs that have waited, and what has none."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from atpid_control.cli import main
from atpid_dynamics.heights import opened
from atpid_dynamics.over_heights import HeightSweep, Way, over_heights
from atpid_sim.engine import columns, drive
from atpid_sim.outcome import Outcome
from atpid_sim.periodic import SteadyEnding, steady_state
from atpid_sim.periodic.run_on import rows_until
from atpid_sim.periodic.solve import Method
from atpid_sim.periodic.steady import extrapolated
from atpid_sim.scene import Scene, load_scene, scene_from_mapping
from atpid_sim.simulation.batch import Batch, Workers
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration, Observation, sample_series
from studies.sweep.measure import standard_task

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")
SYSTEMS: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "systems.yaml").read_text(encoding="utf-8"))


def settled(scene: Scene, fidelity: str, rtol: float, duration: float = 80.0) -> float:
    """Amplitude of the same scene after so long [m]."""
    longer = scene.with_(duration=duration, steady_window=[duration - 1.0, duration])
    return Integration(longer, fidelity, rtol).run(Observation(longer.steady_window)).last.amplitude


def test_the_standard_task_is_what_it_settles_to() -> None:
    found = steady_state(STANDARD, "soft", 1e-9).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(STANDARD, "soft", 1e-10), rel=1e-8)
    assert found.error_estimate < 1e-8
    assert found.periods == 1
    assert sorted(found.impacts["wall"]) == [-1.0, 1.0]
    assert found.followed < 12.0


@pytest.mark.parametrize(
    "task", [(0.0020364, 0.0656061, 0.97500), (0.002109, 0.0697, 0.71566), (0.01414152, 0.05031186, 0.48270038)]
)
def test_a_motion_that_the_transient_only_passes_is_not_called_steady(task: tuple[float, float, float]) -> None:
    """Near grazing: some are unstable, though the derivative beside them is not; the run ends in another motion."""
    search = steady_state(standard_task(*task), "soft", 1e-8)
    if search.state is None:
        assert search.ending in (SteadyEnding.IRREGULAR, SteadyEnding.BY_CHANCE)
    else:
        assert search.state.amplitude == pytest.approx(settled(standard_task(*task), "soft", 1e-10, 800.0), rel=1e-5)


@pytest.mark.parametrize(
    ("scene", "fidelity"),
    [
        (STANDARD.with_(contact={"law": "impact", "restitution": 0.146}), "impact"),
        (load_scene(SCENES / "sticking.yaml"), "soft"),
        (standard_task(0.015366, 0.1756, 0.07051), "soft"),  # steps shrink where the tabulated derivative is off
        (standard_task(0.003493, 0.0757, 0.03756), "soft"),
    ],
)
def test_impacts_sticking_and_shrunk_steps_have_what_they_settle_to(scene: Scene, fidelity: str) -> None:
    found = steady_state(scene, fidelity, 1e-8).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, fidelity, 1e-10), rel=1e-7)
    assert found.settling_periods == pytest.approx(-1.0 / np.log(abs(found.multipliers[0])))


def test_passages_of_a_linear_map_are_extrapolated_to_its_fixed_point() -> None:
    scale, end = np.array([1e-2, 0.3, 1e-2, 0.3]), np.array([0.03, -0.8, 0.09, 1.3])
    turned = np.array([[1.0, 0.2, 0.0, 0.1], [0.0, 1.0, 0.3, 0.0], [0.1, 0.0, 1.0, 0.2], [0.0, 0.1, 0.0, 1.0]])
    powers = np.array([0.9, -0.5, 0.3])[None] ** np.arange(6)[:, None]
    passages = end + np.hstack([0.02 * powers, np.zeros((6, 1))]) @ turned * scale
    np.testing.assert_allclose((extrapolated(passages, scale) - end) / scale, 0.0, atol=1e-9)


def test_what_has_no_steady_motion_is_named() -> None:
    irregular = load_scene(SCENES / "irregular.yaml")
    assert steady_state(irregular, "soft", 1e-6).ending == SteadyEnding.IRREGULAR
    closed = STANDARD.with_(ceiling={"height": 0.017})
    held = steady_state(closed, "soft", 1e-6).state
    assert held is not None
    assert held.amplitude == pytest.approx(settled(closed, "soft", 1e-9), rel=1e-5)
    assert held.method == Method.WAITED
    assert list(held.multipliers[2:]) == [0.0, 0.0]  # the grain has no motion of its own
    ramp = STANDARD.with_(excitation={"amplitude": [[0.0, 0.01], [16.0, 0.02]], "frequency": "resonance"})
    free = STANDARD.with_(excitation={"free": {"deflection": 0.2}})
    for scene in (ramp, free):
        assert steady_state(scene, "soft", 1e-6).ending == SteadyEnding.CHANGING


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "standard.yaml")
    assert main(["simulate", scene, "--steady", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["amplitude"] == pytest.approx(0.045608444, rel=1e-6)
    beam, omega = STANDARD.beam, 2.0 * math.pi * STANDARD.frequency_hz
    spring = complex(beam.stiffness, beam.damping * omega)
    closed = 0.01 * abs(spring / (spring - STANDARD.total_mass * omega**2))  # settled as well, not as in the window
    assert values["undamped_amplitude"] == pytest.approx(closed, rel=1e-9)
    assert values["efficiency"] == pytest.approx(1.0 - values["amplitude"] / closed, rel=1e-9)
    assert 0.0 < values["stability_margin"] < 1.0
    assert main(["simulate", str(SCENES / "irregular.yaml"), "--steady", "--fidelity", "impact", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("steady: ")
    assert printed.err.count("\n") == 1
    assert json.loads(printed.out)["motion"] == "irregular"


def run_on(scene: Scene) -> tuple[float, int]:
    """Amplitude [m] after 600 periods more, and the periods after which the motion repeats itself; 0: it does not."""
    integration, period = Integration(scene, complete_fidelity(scene), 1e-6), 1.0 / scene.frequency_hz
    end = scene.duration + 600.0 * period
    begin, series, state = end - 64.0 * period, sample_series(64), integration.initial_state()
    rows = drive.cut(rows_until(scene, end), [begin])
    assert integration.advance(state, rows, Observation((begin, end), begin, period, series)) == Outcome.DONE
    looks = series[columns.S_BEAM] / state.amplitude
    repeated = (periods for periods in range(1, 9) if np.abs(looks[periods:] - looks[:-periods]).max() <= 1e-5)
    return state.amplitude, next(repeated, 0)


@pytest.mark.parametrize(
    ("name", "method", "periods"),
    [
        ("two periods", Method.LONG, 2),
        ("a long transient", Method.LONG, 1),
        ("a weak drive", Method.WAITED, 1),
        ("sticking", Method.SHORT, 1),  # tabulated contacts give multipliers that are off by 0.02
        ("a grain that never flies", Method.WAITED, 1),
    ],
)
def test_what_a_long_run_comes_to_is_found(name: str, method: Method, periods: int) -> None:
    scene = scene_from_mapping(SYSTEMS["steady"][name])
    found = steady_state(scene).state
    assert found is not None
    assert (found.method, found.periods) == (method, periods)
    amplitude, repeated = run_on(scene)
    assert repeated == periods
    assert found.amplitude == pytest.approx(amplitude, rel=1e-4 + found.error_estimate)


def missed(scene: Scene, found: HeightSweep) -> int:
    """Compare each steady motion with a long run at its height; return how many regular heights have none."""
    runs = Batch(lambda height: run_on(opened(scene, height)), found.heights.tolist()).run(Workers(2), lambda _: None)
    amplitudes, regular = np.array([one[0] for one in runs]), np.array([one[1] for one in runs]) > 0
    steady = found.periods > 0
    assert regular[steady].all()
    errors = np.abs(found.amplitudes / amplitudes - 1.0)[steady]
    assert (errors <= np.maximum(1e-4, np.nan_to_num(found.errors[steady]))).all()
    return int(regular.sum() - steady.sum())


TASK = standard_task(0.01, 0.1, 0.2)
#: Over the regular range, doublings, an irregular range and the cliff behind which nothing settles.
HEIGHTS = np.linspace(0.14, 0.22, 257)


@pytest.fixture(scope="module")
def swept() -> HeightSweep:
    (found,) = over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(1))
    return found


def test_each_is_the_motion_that_its_own_run_comes_to(swept: HeightSweep) -> None:
    assert missed(TASK, swept) <= 0.1 * np.count_nonzero(swept.periods)
    assert np.count_nonzero(swept.ways == Way.NEIGHBOUR) > 100


@pytest.mark.parametrize("name", SYSTEMS["over heights"])
def test_random_systems_are_judged_right(name: str) -> None:
    scene = scene_from_mapping(SYSTEMS["over heights"][name])
    diameter = 2.0 * scene.grain.radius
    heights = diameter + (scene.ceiling.heights[-1][1] - diameter) * np.linspace(0.4, 1.2, 48)
    (found,) = over_heights([scene], heights)
    missed(scene, found)
