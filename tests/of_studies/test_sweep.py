# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frequency sweeps as drive tables, and sweeps over the height of the ceiling."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_sim.engine import columns
from atpid_sim.engine.arc import support_at
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.excitation import support_rows
from atpid_sim.simulation.heights import opened
from atpid_sim.simulation.simulate import simulate
from studies.cli import main
from studies.sweep.measure import sweep

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")


def swept(first: float, last: float, length: float, duration: float) -> Scene:
    return STANDARD.with_(
        excitation={"sweep": {"amplitude": 1.0, "from": first, "to": last, "duration": length}},
        duration=duration,
        steady_window=[0.0, duration],
    )


@pytest.mark.parametrize(
    ("first", "last", "length", "duration"),
    [
        (3.0, 8.0, 40.0, 40.0), (8.0, 3.0, 40.0, 40.0), (4.0, 7.0, 5.0, 9.0), (1.0, 2.0, 100.0, 10.0),
        (0.01, 1000.0, 1.0, 1.0), (1000.0, 1e-6, 0.5, 0.5), (1e-6, 50.0, 2.0, 2.0), (5.0, 5.0, 3.0, 3.0),
    ],
)  # fmt: skip
def test_a_sweep_is_within_its_error_everywhere(first: float, last: float, length: float, duration: float) -> None:
    rows = support_rows(swept(first, last, length, duration))
    assert rows[0, columns.START] == 0.0
    assert rows[-1, columns.END] == pytest.approx(duration, rel=1e-15)
    assert np.array_equal(rows[1:, columns.START], rows[:-1, columns.END])
    rise = (last - first) / length
    for t in np.random.default_rng(1).uniform(0.0, duration, 2000):
        row = rows[np.searchsorted(rows[:, columns.START], t, side="right") - 1]
        found = support_at(row, t - row[columns.START])[0]
        turning = min(t, length)
        turns = first * turning + 0.5 * rise * turning**2 + last * max(0.0, t - length)
        assert found == pytest.approx(np.sin(2.0 * np.pi * (turns % 1.0)), abs=2.6e-9)


def test_knots_follow_the_frequency() -> None:
    rows = support_rows(swept(1.0, 99.0, 10.0, 10.0))
    assert len(rows) == pytest.approx(200 * 50.0 * 10.0, rel=0.05)  # 200 a period of the mean, not of the highest
    assert np.diff(rows[:, columns.START])[0] > 20.0 * np.diff(rows[:, columns.START])[-1]


def test_a_sweep_that_fills_the_memory_is_refused_at_once() -> None:
    with pytest.raises(SceneError, match=r"excitation\.sweep: given 50\d+ periods in 1000 s; allowed: 25000 periods"):
        support_rows(swept(1.0, 1000.0, 1000.0, 1000.0))


@pytest.mark.parametrize(
    ("ceiling", "kind"),
    [
        ({"height": 0.1}, "fixed"), ({"profile": [[0.0, 0.1]]}, "fixed"),
        ({"profile": [[0.0, 0.017], [1.0, 0.05], [2.0, 0.1]]}, "opening"),
        ({"closed": 0.017, "open": 0.1, "start": 1.0, "end": 2.0}, "opening"),
    ],
)  # fmt: skip
def test_heights_of_any_ceiling_are_swept(ceiling: dict[str, Any], kind: str) -> None:
    scene = STANDARD.with_(ceiling=ceiling, duration=3.0, steady_window=[2.0, 3.0])
    done = sweep(scene, 0.05, 0.2, 2)
    assert done.heights.tolist() == [0.05, 0.2]
    assert done.amplitudes[0] != done.amplitudes[1]
    alone = {"height": 0.2} if kind == "fixed" else {"closed": ceiling.get("closed", 0.017), "open": 0.2}
    if kind == "opening":
        alone |= {"start": 1.0, "end": 2.0}
    assert sweep(scene.with_(ceiling=alone), 0.2, 0.2, 1).amplitudes[0] == done.amplitudes[1]


def test_a_controlled_ceiling_and_no_height_are_refused() -> None:
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
    with pytest.raises(SceneError, match=r"a controller moves \(lookup\); allowed in a single run: one of {height}, "):
        sweep(STANDARD.with_(ceiling=ceiling), 0.1, 0.2, 2)
    with pytest.raises(ValueError, match="count: given 0; allowed: at least 1 height"):
        sweep(STANDARD, 0.1, 0.2, 0)


@pytest.mark.parametrize("arguments", [["--points", "0"], ["--points", "-1"], ["--points", "x"], ["--rtol", "0"]])
def test_the_command_refuses_what_it_cannot_do(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", *arguments]) == 2
    assert f"error: {arguments[0]}: given {arguments[1]}; allowed: " in capsys.readouterr().err


def test_the_command_sweeps_one_height(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "--points", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["best_height"] == 0.02


@pytest.mark.parametrize("fidelity", ["simplified", "impact", "finite", "soft"])
def test_a_sweep_has_what_each_height_has_alone(fidelity: str) -> None:
    """To the last digit, although what the runs have in common is integrated once; closed and open ceilings mixed."""
    scene = STANDARD.with_(duration=8.5, steady_window=[8.0, 8.5])
    done = sweep(scene, 0.017, 0.2, 4, 1e-4, fidelity)
    alone = [simulate(opened(scene, float(height)), fidelity, 1e-4, check=False) for height in done.heights]
    assert done.amplitudes.tolist() == [result.amplitude for result in alone]
    assert done.residuals.tolist() == [result.energy_residual for result in alone]
    assert done.impacts.tolist() == [result.impacts for result in alone]
    assert (done.integration_s > 0.0).all()


@pytest.mark.parametrize(("rtol", "level"), [("1e-2", "impact"), ("1e-4", "finite"), ("1e-6", "soft")])
def test_a_sweep_takes_the_cheapest_level_and_prints_it(
    rtol: str, level: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "--points", "4", "--rtol", rtol]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["fidelity"] == level
    assert result["model_error"] <= float(rtol)


def test_a_height_that_cannot_be_simulated_ends_the_sweep() -> None:
    deep = STANDARD.with_(contact={"law": "hertz", "young_modulus": 2e4, "poisson_ratio": 0.2}, tolerance=1e-3)
    with pytest.raises(NumericalFailure, match=r"deeper into a wall than its radius.* \(at \d"):
        sweep(deep, 0.1, 0.2, 3)


def test_an_interrupted_sweep_goes_on_where_it_stopped(tmp_path: Path) -> None:
    scene, journal = STANDARD.with_(duration=8.5, steady_window=[8.0, 8.5]), tmp_path / "sweep.journal"

    def stop(done: int) -> None:
        if done >= 32:
            raise KeyboardInterrupt

    swept_once = partial(sweep, scene, 0.02, 0.4, 40, 1e-4, "impact")
    with pytest.raises(KeyboardInterrupt, match=r"interrupted: 2 of 3 done; the same command goes on from them"):
        swept_once(stop, Workers(1), journal)
    again = swept_once(None, Workers(1), journal)
    assert again.computed == 8
    assert not journal.exists()
    assert again.amplitudes.tolist() == swept_once().amplitudes.tolist()
