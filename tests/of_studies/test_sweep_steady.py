# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions over heights: each is the one its own run comes to, and what has none is named."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_sim.engine import columns
from atpid_sim.periodic import steady_state
from atpid_sim.periodic.over_heights import HeightSweep, Way, over_heights
from atpid_sim.scene import Scene, SceneError
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.heights import opened
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import simulate
from studies.cli import main as studies
from studies.steady.systems import drawn
from studies.sweep.measure import standard_task
from studies.sweep.steady import compared

PATH = Path(__file__).parents[2] / "scenes" / "standard.yaml"
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


def test_where_nothing_settles_the_run_itself_is_the_answer(swept: HeightSweep) -> None:
    """To the last digit: nothing of a neighbour is in it."""
    places = np.flatnonzero(swept.ways == Way.UNSETTLED)
    assert len(places) > 50
    assert np.isnan(swept.errors[places]).all()
    assert not swept.periods[places].any()
    for place in places[[0, len(places) // 2, -1]]:
        alone = simulate(opened(TASK, float(HEIGHTS[place])), "finite", 1e-4, check=False)
        assert swept.amplitudes[place] == alone.amplitude


def test_multipliers_and_periods_are_those_of_the_search_at_one_height(swept: HeightSweep) -> None:
    for place in np.flatnonzero(swept.ways == Way.NEIGHBOUR)[::40]:
        one = steady_state(opened(TASK, float(HEIGHTS[place])), "soft", 1e-6).state
        assert one is not None
        assert one.periods == swept.periods[place]
        assert swept.amplitudes[place] == pytest.approx(one.amplitude, rel=swept.errors[place])
        # taken at a neighbour, up to 32 heights before
        assert swept.multipliers[place] == pytest.approx(abs(one.multipliers[0]), abs=0.05)


def test_workers_and_a_journal_change_nothing(swept: HeightSweep, tmp_path: Path) -> None:
    journal = tmp_path / "sweep.journal"

    def stop(done: int) -> None:
        if done >= 128:
            raise KeyboardInterrupt

    for progress in (stop, None):
        if progress is not None:
            with pytest.raises(KeyboardInterrupt, match="interrupted: 1 of 3 done"):
                over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(1), progress, journal)
            continue
        (again,) = over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(2), None, journal)
    assert len(journal.read_text().splitlines()) == 4
    for name in ("heights", "amplitudes", "errors", "multipliers", "periods", "ways"):
        assert np.array_equal(getattr(again, name), getattr(swept, name), equal_nan=name in ("errors", "multipliers"))


@pytest.mark.parametrize("number", [3, 6])  # a hysteretic law; instantaneous impacts
def test_random_systems_are_judged_right(number: int) -> None:
    scene = drawn(5, number).with_(tolerance=1e-4)
    diameter = 2.0 * scene.grain.radius
    heights = diameter + (scene.ceiling.heights[-1][1] - diameter) * np.linspace(0.4, 1.2, 48)
    (found,) = over_heights([scene], heights)
    judged = compared(scene, found, Workers(2), lambda _: None)
    assert judged["another"] == judged["not_regular"] == []
    assert judged["same"] == judged["steady_found"]


def test_several_amplitudes_and_masses_are_rows_of_their_own() -> None:
    heights = np.linspace(0.08, 0.1, 9)
    scenes = [TASK, TASK.with_(amplitude=0.012), TASK.with_(mass_fraction=0.08)]
    together = over_heights(scenes, heights, "impact", 1e-4)
    for scene, row in zip(scenes, together, strict=True):
        (alone,) = over_heights([scene], heights, "impact", 1e-4)
        assert alone.amplitudes.tolist() == row.amplitudes.tolist()
        assert (row.periods == 1).all()
    assert len({row.amplitudes[0] for row in together}) == 3


def test_a_run_that_does_not_reach_its_end_is_named() -> None:
    deep = TASK.with_(contact={"law": "hertz", "young_modulus": 2e4, "poisson_ratio": 0.2}, tolerance=1e-3)
    (found,) = over_heights([deep], np.array([0.1, 0.2]), "soft")
    assert (found.ways == Way.FAILED).all()
    assert np.isnan(found.amplitudes).all()
    assert "2 without a run to the end" in found.sentence


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (TASK.with_(steady_window=[6.5, 16.0]), "with changes until 7 s"),
        (TASK.with_(further_dampers=[{"mass_fraction": 0.1, "height": 0.1}]), "takes one damper"),
        (TASK.with_(excitation={"sweep": {"amplitude": 0.01, "from": 4.0, "to": 6.0}}), "a tone"),
    ],
)
def test_what_changes_until_the_window_is_refused(scene: Scene, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        over_heights([scene], np.array([0.1, 0.2]), "impact")


def test_heights_that_do_not_rise_are_refused() -> None:
    with pytest.raises(ValueError, match="allowed: at least one, each above the one before"):
        over_heights([TASK], np.array([0.2, 0.1]))


@pytest.mark.parametrize("fidelity", ["impact", "finite", "soft"])
def test_without_a_ledger_the_motion_is_the_same(fidelity: str) -> None:
    integration = Integration(TASK, fidelity, 1e-4)
    kept, left = integration.initial_state(), integration.initial_state()
    left.y[columns.INPUT] = math.nan
    for state in (kept, left):
        integration.advance(state, integration.table)
    places = [columns.BEAM, columns.BEAM_VELOCITY, columns.GRAIN, columns.GRAIN_VELOCITY]
    assert kept.y[places].tolist() == left.y[places].tolist()
    assert math.isnan(left.y[columns.INPUT])


def test_the_command_prints_and_writes_heights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "sweep.csv"
    line = ["sweep", str(PATH), "--heights", "0.08:0.1:21", "--amplitudes", "0.009:0.01:2", "--fidelity", "impact"]
    assert main([*line, "--out", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2
    assert printed[0].startswith("grain 0.1, support 0.009 m: 21 of 21 heights with a steady motion, ")
    written = list(csv.DictReader(out.read_text().splitlines()))
    assert list(tmp_path.iterdir()) == [out]
    assert main([*line, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == len(written) == 42
    assert [float(row["amplitudes"]) for row in written] == [row["amplitudes"] for row in rows]
    assert {row["ways"] for row in rows} == {"neighbour", "own"}


def test_the_study_prints_both_speeds_and_the_judgement(capsys: pytest.CaptureFixture[str]) -> None:
    assert studies(["sweep", "--points", "12", "--rtol", "1e-2", "--fidelity", "impact", "--steady"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["steady_per_second"] > 0.0
    assert result["steady"]["heights"] == 12
