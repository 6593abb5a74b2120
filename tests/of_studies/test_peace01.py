# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of several modes against other methods: a published benchmark, long runs of random structures."""

import csv
from pathlib import Path

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_sim.periodic import Branch
from atpid_sim.scene import standard_bench
from studies import peace01
from studies.cli import main as studies
from studies.peace01 import FIRST, HarmonicBalance, branch, checked, distance, second_mass, stopped
from studies.steady.command import compare


@pytest.fixture(scope="module")
def curve() -> Branch:
    return branch(stopped())


def test_published_benchmark(curve: Branch) -> None:
    """NLvib's PEACE01 against scipy's integration, and as a curve against harmonic balance of 25 orders."""
    integration = stopped()
    ratios = np.array([motion.conditions.frequency / FIRST for motion in curve.motions])
    assert ratios[[0, -1]] == pytest.approx([0.8, 1.4], rel=1e-9)
    fold = next(each.motion for each in curve.bifurcations if each.loss.name == "FOLD")
    assert fold.conditions.frequency / FIRST == pytest.approx(1.1977, abs=3e-4)
    points = np.array(
        [[motion.conditions.frequency / FIRST, second_mass(integration, motion)] for motion in curve.motions]
    )
    assert np.median(distance(points, HarmonicBalance(25).curve())) < 1e-4
    for motion in curve.motions[10::25]:
        apart, multiplier = checked(motion)
        assert apart < 1e-8
        assert multiplier == pytest.approx(motion.largest_multiplier, rel=1e-3)


def test_random_structures_have_the_motion_and_the_multiplier_of_a_long_run() -> None:
    compared = [compare(6, number, modal=True) for number in (5, 9, 18, 58)]
    assert all(one.due and one.same and one.multiplier_right for one in compared)


def test_a_run_that_passes_another_motion_close_by_goes_on() -> None:
    """Two motions lie within 2 % of their size, and the transient comes as near to the wrong one."""
    one = compare(5, 11, modal=True)
    assert one.due == one.found
    assert one.same or not one.due


def test_the_study_s_page_of_numbers(
    curve: Branch, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peace01, "branch", lambda _integration: curve)
    monkeypatch.setattr(peace01, "_CHECKED", 2)
    monkeypatch.setattr(peace01, "_STEP", 4.0 * peace01._STEP)
    assert studies(["peace01", "--order", "15"]) == 0
    printed = capsys.readouterr().out
    assert "return map" in printed
    assert "ends stability" in printed


def test_cliffs_of_a_structure_of_two_modes_under_a_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = standard_bench(
        contact={"law": "impact", "restitution": 0.3}, ceiling={"height": 0.06}, duration=20.0, drive="force",
        excitation={"amplitude": 4.0, "frequency": 5.2},
        further_modes=[{"mass": 0.9, "frequency": 31.0, "damping_ratio": 0.01, "drive_factor": -0.4}],
    )  # fmt: skip
    path, out, picture = tmp_path / "s.yaml", tmp_path / "c.csv", tmp_path / "c.png"
    path.write_text(scene.to_yaml(), encoding="utf-8")
    arguments = ["cliffs", str(path), "--height", "0.1:0.2", "--amplitudes", "3.8:4.2"]
    assert main([*arguments, "--out", str(out), "--picture", str(picture)]) == 0
    assert "the stable motion ends" in capsys.readouterr().out
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert {row["curve"] for row in rows} == {"branch", "bifurcation", "cliff"}
    assert all(3.8 - 1e-9 <= float(row["amplitude"]) <= 4.2 + 1e-9 for row in rows)
    assert picture.stat().st_size > 10_000
