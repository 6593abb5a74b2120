# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions without waiting: against runs that have waited, their multipliers, and what has none."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_sim.engine import columns
from atpid_sim.engine.settling_run import _middle_of_longest_flight
from atpid_sim.periodic import Method, SteadyEnding, steady_state
from atpid_sim.periodic.newton import extrapolated
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.integration import Integration, Observation
from studies.cli import main as studies
from studies.steady.command import compare
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


def test_a_disturbance_dies_out_as_the_multipliers_state() -> None:
    """The run that waits comes nearer by the leading multiplier each period."""
    found = steady_state(STANDARD, "soft", 1e-9).state
    assert found is not None
    leading = abs(found.multipliers[0])
    period = 1.0 / STANDARD.frequency_hz

    def off(end: float) -> float:
        scene = STANDARD.with_(duration=end, steady_window=[end - 2.0 * period, end])
        run = Integration(scene, "soft", 1e-10).run(Observation(scene.steady_window))
        return abs(run.last.amplitude - found.amplitude)

    early, late = 14.0, 14.0 + 20.0 * period
    assert (off(late) / off(early)) ** (1.0 / 20.0) == pytest.approx(leading, rel=0.01)
    assert found.settling_periods == pytest.approx(-1.0 / np.log(leading))


def test_instantaneous_impacts_are_exact() -> None:
    scene = STANDARD.with_(contact={"law": "impact", "restitution": 0.146})
    found = steady_state(scene, "impact", 1e-9).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, "impact", 1e-9), rel=1e-8)


def test_a_sticking_grain_has_a_steady_motion_too() -> None:
    scene = load_scene(SCENES / "sticking.yaml")
    found = steady_state(scene, "soft", 1e-8).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, "soft", 1e-9), rel=1e-7)


@pytest.mark.parametrize("task", [(0.015366, 0.1756, 0.07051), (0.003493, 0.0757, 0.03756)])
def test_steps_shrink_where_the_tabulated_derivative_is_off(task: tuple[float, float, float]) -> None:
    scene = standard_task(*task)
    found = steady_state(scene, "soft", 1e-8).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, "soft", 1e-10), rel=3e-8)


@pytest.mark.parametrize(
    "task",
    [
        (0.002036426956816831, 0.06560612133507332, 0.9750006206839329),
        (0.002109, 0.0697, 0.71566),
        (0.014141519528659144, 0.05031186455438512, 0.48270037598620913),
    ],
)
def test_a_motion_that_the_transient_only_passes_is_not_called_steady(task: tuple[float, float, float]) -> None:
    """Near grazing: some are unstable, though the derivative beside them is not; the run ends in another motion."""
    search = steady_state(standard_task(*task), "soft", 1e-8)
    if search.state is None:
        assert search.ending in (SteadyEnding.IRREGULAR, SteadyEnding.BY_CHANCE)
    else:
        assert search.state.amplitude == pytest.approx(settled(standard_task(*task), "soft", 1e-10, 800.0), rel=1e-5)


def test_a_motion_left_to_chance_is_not_called_steady() -> None:
    """Which of two motions follows on a chaotic transient depends on the last digits of the run."""
    scene = standard_task(0.007592504669600599, 0.15842142067381484, 0.6012653243439732)
    ends = [settled(scene, "finite", rtol) for rtol in (1e-4, 1e-6)]
    assert ends[1] > 1.5 * ends[0]
    assert steady_state(scene, "soft", 1e-8).ending == SteadyEnding.BY_CHANCE


def test_multipliers_are_those_of_the_motion_and_not_of_one_beside_it() -> None:
    """Near grazing: the derivative beside the motion is too stable."""
    slow = steady_state(standard_task(0.04110867968085944, 0.08510380050499104, 0.6503486436299505), "soft", 1e-8).state
    assert slow is not None
    assert abs(slow.multipliers[0]) == pytest.approx(0.984, abs=2e-3)


@pytest.mark.parametrize("flights", [[range(100, 128), range(21), range(40, 81)], [range(128)], []])
def test_the_section_lies_in_the_middle_of_the_longest_flight(flights: list[range]) -> None:
    """Of a period taken as a ring: the longest of the first case goes from sample 100 over the end to sample 20."""
    samples = np.zeros((columns.SAMPLE_ROWS, 128))
    samples[columns.S_GRAIN, [place for flight in flights for place in flight]] = 1e-3
    middle = _middle_of_longest_flight(samples, 0.1)
    assert middle in {0: [-1], 1: range(128), 3: [123, 124, 125]}[len(flights)]
    assert _middle_of_longest_flight(samples, 1e-3) == -1  # in contact with the ceiling


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
    assert values["periods"] == 1
    beam, omega = STANDARD.beam, 2.0 * math.pi * STANDARD.frequency_hz
    spring = complex(beam.stiffness, beam.damping * omega)
    closed = 0.01 * abs(spring / (spring - STANDARD.total_mass * omega**2))  # settled as well, not as in the window
    assert values["undamped_amplitude"] == pytest.approx(closed, rel=1e-9)
    assert values["efficiency"] == pytest.approx(1.0 - values["amplitude"] / closed, rel=1e-9)
    assert 0.0 < values["stability_margin"] < 1.0
    assert main(["simulate", scene, "--steady"]) == 0
    assert "settling_periods" in capsys.readouterr().out
    assert main(["simulate", str(SCENES / "irregular.yaml"), "--steady", "--fidelity", "impact", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("steady: the motion does not come to repeat itself")
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


def test_the_study_puts_its_table_into_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, journal = tmp_path / "page.md", tmp_path / "systems.journal"
    page.write_text("before\n<!-- made by python -m studies steady -->\n<!-- end -->\nafter\n")
    arguments = ["steady", "--systems", "2", "--seed", "4", "--workers", "1", "--journal", str(journal)]
    assert studies([*arguments, "--page", str(page)]) == 0
    text = page.read_text()
    assert "| all | 2 | 2 | 2 | 2 | 2 | 2 | 0 of 0 | 0 of 0 | 0 of 0 |" in text
    assert text.startswith("before\n")
    assert text.endswith("<!-- end -->\nafter\n")
    assert "Not as the judge has it: none." in capsys.readouterr().out
    assert not journal.exists()
