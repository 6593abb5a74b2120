# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions without waiting, at one height and over heights: against runs that have waited, and what has none."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from studies.steady.command import compare
from studies.steady.systems import drawn
from studies.sweep.steady import compared

from atpid_control.cli import main
from atpid_dynamics.over_heights import HeightSweep, over_heights
from atpid_sim.periodic import Method, SteadyEnding, steady_state
from atpid_sim.periodic.steady import extrapolated
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.integration import Integration, Observation
from studies.sweep.measure import standard_task

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")


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
    "task",
    [(0.0020364, 0.0656061, 0.97500), (0.002109, 0.0697, 0.71566), (0.01414152, 0.05031186, 0.48270038)],
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


@pytest.mark.parametrize(
    ("seed", "number", "method", "periods"),
    [
        (4, 35, Method.LONG, 2),
        (4, 26, Method.LONG, 1),
        (4, 27, Method.WAITED, 1),
        (2, 51, Method.SHORT, 1),  # sticks: tabulated contacts give multipliers that are off by 0.02
        (2, 70, Method.WAITED, 1),  # the grain never flies
    ],
)
def test_what_a_long_run_comes_to_is_found(seed: int, number: int, method: Method, periods: int) -> None:
    one = compare(seed, number)
    assert one.due
    assert (one.found, one.method, one.periods, one.judged.periods) == (True, method.name, periods, periods)
    assert one.same
    assert one.multiplier_right


TASK = standard_task(0.01, 0.1, 0.2)
#: Over the regular range, doublings, an irregular range and the cliff behind which nothing settles.
HEIGHTS = np.linspace(0.14, 0.22, 257)


@pytest.fixture(scope="module")
def swept() -> HeightSweep:
    (found,) = over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(1))
    return found


def test_each_is_the_motion_that_its_own_run_comes_to(swept: HeightSweep) -> None:
    judged = compared(TASK, swept, Workers(2), lambda _: None)
    assert judged["another"] == judged["not_regular"] == []
    assert judged["same"] == judged["steady_found"] >= 0.9 * judged["regular"]
    assert judged["by_neighbour"] > 100
    assert judged["above_1e-4"] == 0
    assert judged["largest_error"] < 1e-4


@pytest.mark.parametrize("number", [3, 6])  # a hysteretic law; instantaneous impacts
def test_random_systems_are_judged_right(number: int) -> None:
    scene = drawn(5, number).with_(tolerance=1e-4)
    diameter = 2.0 * scene.grain.radius
    heights = diameter + (scene.ceiling.heights[-1][1] - diameter) * np.linspace(0.4, 1.2, 48)
    (found,) = over_heights([scene], heights)
    judged = compared(scene, found, Workers(2), lambda _: None)
    assert judged["another"] == judged["not_regular"] == []
    assert judged["same"] == judged["steady_found"]
