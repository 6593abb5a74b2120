# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Branches and cliffs of the bench: simulated beside them, and what cannot be followed."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from bench_motions import bench, motion_of
from dynamics_program import main
from sim_refusals import has_parts

from atpid_dynamics.continuation import Bifurcation, follow_branch, follow_cliff
from atpid_sim.periodic import Conditions, Loss, PeriodicMotion, ReturnMap, find_cliff, solve
from atpid_sim.periodic.solve import size_of
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

SCENES = Path(__file__).parents[3] / "scenes"
BENCH_HEIGHTS = {"height": (0.15, 0.3)}


@pytest.fixture(scope="module")
def bench_curve() -> tuple[Integration, tuple[Bifurcation, ...]]:
    """The cliff of the standard bench over the frequency, contacts integrated."""
    integration = bench()
    branch = follow_branch(integration, motion_of(integration, 0.01, 0.19), BENCH_HEIGHTS)
    assert branch.cliff is not None
    return integration, follow_cliff(integration, branch.cliff, BENCH_HEIGHTS | {"frequency": (5.2, 5.75)})


def at_share(motion: PeriodicMotion, share: float) -> Conditions:
    return motion.conditions._replace(height=share * motion.conditions.height)


def stable_near(returns: ReturnMap, motion: PeriodicMotion, scale: Array) -> Array:
    """Section state of the stable motion beside one on a cliff: below a fold it is one of two."""
    values, vectors = np.linalg.eig(motion.slope / scale[:, None] * scale)
    leading = vectors[:, int(np.argmax(np.abs(values)))].real
    tried = (solve(returns, motion.section + part * leading * scale).motion for part in (0.0, 0.1, -0.1, 0.05, -0.05))
    return next(each.section for each in tried if each is not None and each.stability_margin > 0.0)


def test_simulated_the_motion_is_stable_below_the_curve_and_not_above(
    bench_curve: tuple[Integration, tuple[Bifurcation, ...]],
) -> None:
    integration, curve = bench_curve
    assert {each.loss for each in curve} == {Loss.FOLD, Loss.BEATING}
    inner = [each for each in curve[1:-1] if each.motion.conditions.height > 0.164]
    chosen = np.random.default_rng(26).choice(len(inner), 8, replace=False)
    for motion in (inner[place].motion for place in chosen):
        scale = size_of(integration, motion.amplitude, motion.conditions)
        below, above = (at_share(motion, share) for share in (0.998, 1.002))
        stable = stable_near(ReturnMap(integration, below, motion.phase), motion, scale)
        for conditions, start, stays in ((below, stable + 1e-4 * scale, True), (above, motion.section, False)):
            passed = ReturnMap(integration, conditions, motion.phase).passages(start, 1500) / scale
            settled = len(passed) == 1500 and np.abs(np.diff(passed[-100:], axis=0)).max() < 1e-6
            near = float(np.abs(passed[-1] - start / scale).max()) < 0.05
            assert (settled and near) == stays, conditions


def test_a_touch_ends_the_motion_of_a_heavy_grain() -> None:
    integration = bench(0.2)
    branch = follow_branch(integration, motion_of(integration, 0.01, 0.1), {"height": (0.03, 0.35)})
    assert branch.cliff is not None
    assert branch.cliff.loss is Loss.GRAZING
    found = find_cliff(integration, branch.motions[0], 0.35, 0.002, 1e-6)
    assert found.loss is Loss.GRAZING
    assert branch.cliff.motion.conditions.height == pytest.approx(found.height, rel=2e-4)
    motion = branch.cliff.motion
    returns = ReturnMap(integration, motion.conditions, motion.phase)
    assert 0.0 < returns.clearance(motion.section) < 1e-4 * motion.amplitude


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "c.csv"
    command = ["cliffs", str(SCENES / "standard.yaml"), "--height", "0.19:0.3", "--amplitudes", "0.0098:0.0102"]
    assert main([*command, "--json", "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == sum(len(part) for part in found.values())
    assert [each["what"] for each in found["bifurcation"]][:2] == ["beating", "fold"]
    assert [found["cliff"][k]["amplitude"] for k in (0, -1)] == pytest.approx([0.0098, 0.0102])


def test_what_cannot_be_followed_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for line, status, parts in (
        ("standard.yaml --height 0.19:0.3 --frequencies 6:7", 2, "excitation.frequency 5.46997"),
        ("standard.yaml --height 0.017:0.3", 3, "0.017 m no motion"),
        ("free_decay.yaml --height 0.19:0.3", 3, "no motion excitation"),
    ):
        name, *options = line.split()
        assert main(["cliffs", str(SCENES / name), *options]) == status
        has_parts(capsys.readouterr().err.removesuffix("\n"), tuple(parts.split()))
