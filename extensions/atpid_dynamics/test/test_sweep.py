# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steady motions, and shares that come to them, over heights: against runs at each of them, and what is refused."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dynamics_program import main
from sim_refusals import has_parts, refused

import atpid_sim as ap
from atpid_dynamics.heights import opened
from atpid_dynamics.over_heights import HeightSweep, Way, over_heights
from atpid_sim.periodic import steady_state
from atpid_sim.scene import SceneError, load_scene, standard_bench
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.simulate import simulate

SCENES = Path(__file__).parents[3] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")
TASK = standard_bench(
    excitation={"amplitude": 0.01, "frequency": "resonance"},
    ceiling={"closed": 0.017, "open": 0.2, "start": 6.0, "end": 7.0},
    steady_window=[14.0, 16.0],
)
#: Over the regular range, doublings, an irregular range and the cliff behind which nothing settles.
HEIGHTS = np.linspace(0.14, 0.22, 257)
SCENE = ap.standard_bench(contact={"law": "impact", "restitution": 0.2}, duration=8.0)


@pytest.fixture(scope="module")
def swept() -> HeightSweep:
    (found,) = over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(1))
    return found


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

    with pytest.raises(KeyboardInterrupt, match=r"1.*3"):
        over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(1), stop, journal)
    (again,) = over_heights([TASK], HEIGHTS, "finite", 1e-4, Workers(2), None, journal)
    assert len(journal.read_text().splitlines()) == 4
    for name in ("heights", "amplitudes", "errors", "multipliers", "periods", "ways"):
        assert np.array_equal(getattr(again, name), getattr(swept, name), equal_nan=name in ("errors", "multipliers"))


def test_several_amplitudes_and_masses_are_rows_of_their_own() -> None:
    heights = np.linspace(0.08, 0.1, 9)
    scenes = [TASK, TASK.with_(amplitude=0.012), TASK.with_(mass_fraction=0.08)]
    together = over_heights(scenes, heights, "impact", 1e-4)
    alone = [over_heights([scene], heights, "impact", 1e-4)[0].amplitudes.tolist() for scene in scenes]
    assert [row.amplitudes.tolist() for row in together] == alone
    assert len({row[0] for row in alone}) == 3


def test_a_run_that_does_not_reach_its_end_is_named() -> None:
    deep = TASK.with_(contact={"law": "hertz", "young_modulus": 2e4, "poisson_ratio": 0.2}, tolerance=1e-3)
    (found,) = over_heights([deep], np.array([0.1, 0.2]), "soft")
    assert (found.ways == Way.FAILED).all()
    assert np.isnan(found.amplitudes).all()
    assert re.search(r"\b2 without", found.sentence)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"steady_window": [6.5, 16.0]}, "7 s"),
        ({"further_dampers": [{"mass_fraction": 0.1, "height": 0.1}]}, "one damper"),
        ({"excitation": {"sweep": {"amplitude": 0.01, "from": 4.0, "to": 6.0}}}, "tone"),
    ],
)
def test_what_changes_until_the_window_is_refused(change: dict[str, Any], part: str) -> None:
    with refused(SceneError, part):
        over_heights([TASK.with_(**change)], np.array([0.1, 0.2]), "impact")
    with pytest.raises(ValueError, match=r"above.*before"):
        over_heights([TASK], np.array([0.2, 0.1]))


def test_the_command_prints_and_writes_heights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, options = tmp_path / "sweep.csv", "--heights 0.08:0.1:21 --amplitudes 0.009:0.01:2 --fidelity impact --json"
    assert main(["sweep", str(SCENES / "standard.yaml"), *options.split(), "--out", str(out)]) == 0
    rows = json.loads(capsys.readouterr().out)
    written = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == len(written) == 42
    assert [float(row["amplitudes"]) for row in written] == [row["amplitudes"] for row in rows]
    assert {row["ways"] for row in rows} == {"neighbour", "own"}


@pytest.mark.parametrize(
    ("ceiling", "expected"),
    [
        ({"height": 0.1}, ((0.0, 0.2),)),
        ({"profile": [[0.0, 0.017], [1.0, 0.05], [2.0, 0.1]]}, ((1.0, 0.017), (2.0, 0.2))),
        ({"closed": 0.017, "open": 0.1, "start": 1.0, "end": 2.0}, ((1.0, 0.017), (2.0, 0.2))),
    ],
)
def test_any_ceiling_is_opened_to_a_height(ceiling: dict[str, Any], expected: tuple[tuple[float, float], ...]) -> None:
    scene = STANDARD.with_(ceiling=ceiling, duration=3.0, steady_window=[2.0, 3.0])
    assert opened(scene, 0.2).ceiling.heights == expected


def test_a_controlled_ceiling_is_refused() -> None:
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
    with refused(SceneError, "lookup", "height"):
        opened(STANDARD.with_(ceiling=ceiling), 0.1)


def test_a_sweep_is_its_runs() -> None:
    heights, amplitudes, fractions = np.linspace(0.06, 0.12, 4), [0.005, 0.01], [0.1, 0.2]
    swept = ap.sweep(SCENE, heights, amplitudes, fractions)
    assert swept.beam_amplitudes.shape == (2, 2, 4)
    for m, a, h in ((0, 0, 0), (1, 0, 3), (0, 1, 2)):
        scene = opened(SCENE.with_(mass_fraction=fractions[m], amplitude=amplitudes[a]), float(heights[h]))
        if swept.ways[m, a, h] != "unsettled":
            scene = scene.with_(duration=60.0, steady_window=[50.0, 60.0])
        run = ap.simulate(scene, check=False)
        assert swept.beam_amplitudes[m, a, h] == pytest.approx(run.amplitude, rel=1e-4)
        assert swept.efficiencies[m, a, h] == pytest.approx(run.efficiency, abs=1e-3)
        assert swept.reductions[m, a, h] == pytest.approx(run.reduction, abs=1e-3)
    place = {"mass_fractions": 0.2, "amplitudes": 0.01, "heights": heights[1]}
    assert swept.to_xarray().beam_amplitudes.sel(place) == swept.beam_amplitudes[1, 1, 1]


def test_the_command_prints_and_writes_shares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = str(SCENES / "standard.yaml"), tmp_path / "shares.csv"
    assert main(["basin", scene, "--heights", "0.14:0.24:2", "--kick", "0.1", "--json", "--out", str(out)]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["height"] for row in rows] == [0.14, 0.24]
    assert (rows[0]["share"], rows[1]["share"], rows[1]["starts"]) == (1.0, None, 0)  # the second is irregular
    assert [row["height"] for row in csv.DictReader(out.read_text().splitlines())] == ["0.14", "0.24"]
    assert main(["basin", str(SCENES / "free_decay.yaml")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    has_parts(printed.err.removesuffix("\n"), ("excitation", "tone"))
