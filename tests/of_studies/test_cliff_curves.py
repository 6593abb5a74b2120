# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Branches through folds and cliffs in two parameters: closed forms, direct simulation, the cliff finder, grazing."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from test_periodic import FORCE, bench, motion_of, section_in_flight, two_impacts_scene

from atpid_control.cli import main
from atpid_sim.figure_numbers import numbers_in
from atpid_sim.periodic import (
    Bifurcation,
    Branch,
    Conditions,
    Loss,
    PeriodicMotion,
    ReturnMap,
    find_cliff,
    follow_branch,
    follow_cliff,
    raised,
    solve,
)
from atpid_sim.periodic.solve import size_of
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array
from studies.theory.two_impacts import TwoImpacts, longest_clearance, symmetric_motions

MASS_RATIO, RESTITUTION, DAMPING_RATIO = 0.1, 0.5, 0.01
HEIGHTS = {"height": (5.0, 140.0)}
BENCH_HEIGHTS = {"height": (0.15, 0.3)}


@pytest.fixture(scope="module")
def masri() -> tuple[Integration, Branch]:
    """Two impacts a cycle without gravity, at resonance: the symmetric motion through its fold."""
    system = TwoImpacts(MASS_RATIO, RESTITUTION, 20.0 / FORCE)
    phase, section = section_in_flight(system, symmetric_motions(system)[-1])
    integration = Integration(two_impacts_scene(MASS_RATIO, RESTITUTION), "impact")
    motion = solve(ReturnMap(integration, Conditions(1.0, 0.5 / math.pi, 21.0), phase), section).motion
    assert motion is not None
    return integration, follow_branch(integration, motion, HEIGHTS)


@pytest.fixture(scope="module")
def bench_curve() -> tuple[Integration, tuple[Bifurcation, ...]]:
    """The cliff of the standard bench over the frequency, contacts integrated."""
    integration = bench()
    branch = follow_branch(integration, motion_of(integration, 0.01, 0.19), BENCH_HEIGHTS)
    assert branch.cliff is not None
    return integration, follow_cliff(integration, branch.cliff, BENCH_HEIGHTS | {"frequency": (5.2, 5.75)})


def test_the_branch_turns_at_the_longest_clearance(masri: tuple[Integration, Branch]) -> None:
    _, branch = masri
    fold = next(each for each in branch.bifurcations if each.loss is Loss.FOLD)
    longest = FORCE * longest_clearance(TwoImpacts(MASS_RATIO, RESTITUTION, 1.0, DAMPING_RATIO))
    assert fold.motion.conditions.height == pytest.approx(1.0 + longest, rel=1e-7)
    assert not fold.ends_stability
    heights = [each.conditions.height for each in branch.motions]
    highest = int(np.argmax(heights))
    assert 0 < highest < len(heights) - 1  # it comes back
    assert all(each.stability_margin <= 0.0 for each in branch.motions[highest:])


def test_the_cliff_over_the_frequency_is_that_of_the_closed_form(masri: tuple[Integration, Branch]) -> None:
    integration, branch = masri
    assert branch.cliff is not None
    ratios = 0.963, 1.035
    span = ratios[0] * 0.5 / math.pi, ratios[1] * 0.5 / math.pi
    curve = follow_cliff(integration, branch.cliff, HEIGHTS | {"frequency": span})
    conditions = [each.motion.conditions for each in curve]
    assert [conditions[0].frequency, conditions[-1].frequency] == pytest.approx(span)
    assert len(curve) > 20
    for each in conditions:
        ratio = 2.0 * math.pi * each.frequency

        def largest(clearance: float, ratio: float = ratio) -> float:
            force = math.hypot(1.0, 2.0 * DAMPING_RATIO * ratio)
            system = TwoImpacts(MASS_RATIO, RESTITUTION, clearance / force, DAMPING_RATIO, ratio)
            return symmetric_motions(system)[-1].multiplier

        clearance = each.height - 1.0
        slope = (largest(1.0005 * clearance) - largest(0.9995 * clearance)) / (1e-3 * clearance)
        assert abs((largest(clearance) - 1.0) / slope) < 1e-6  # distance from the boundary of the closed form
    assert {each.loss for each in curve} == {Loss.BEATING}


def test_without_gravity_the_cliff_is_in_proportion_to_the_amplitude(masri: tuple[Integration, Branch]) -> None:
    integration, branch = masri
    assert branch.cliff is not None
    curve = follow_cliff(integration, branch.cliff, {"height": (1.5, 100.0), "amplitude": (0.5, 2.0)})
    conditions = [each.motion.conditions for each in curve]
    assert [conditions[0].amplitude, conditions[-1].amplitude] == pytest.approx([0.5, 2.0])
    clearance = branch.cliff.motion.conditions.height - 1.0
    assert [(each.height - 1.0) / each.amplitude for each in conditions] == pytest.approx(
        [clearance] * len(curve), rel=1e-7
    )


def test_simulated_the_motion_is_stable_below_the_curve_and_not_above(
    bench_curve: tuple[Integration, tuple[Bifurcation, ...]],
) -> None:
    integration, curve = bench_curve
    assert {each.loss for each in curve} == {Loss.FOLD, Loss.BEATING}
    inner = [each for each in curve[1:-1] if each.motion.conditions.height > 0.164]
    chosen = np.random.default_rng(26).choice(len(inner), 20, replace=False)
    for motion in (inner[place].motion for place in chosen):
        scale = size_of(integration, motion.amplitude, motion.conditions)
        below, above = (at_share(motion, share) for share in (0.998, 1.002))
        stable = stable_near(ReturnMap(integration, below, motion.phase), motion, scale)
        for conditions, start, stays in ((below, stable + 1e-4 * scale, True), (above, motion.section, False)):
            passed = ReturnMap(integration, conditions, motion.phase).passages(start, 1500) / scale
            settled = len(passed) == 1500 and np.abs(np.diff(passed[-100:], axis=0)).max() < 1e-6
            near = float(np.abs(passed[-1] - start / scale).max()) < 0.05
            assert (settled and near) == stays, conditions


def at_share(motion: PeriodicMotion, share: float) -> Conditions:
    return motion.conditions._replace(height=share * motion.conditions.height)


def stable_near(returns: ReturnMap, motion: PeriodicMotion, scale: Array) -> Array:
    """Section state of the stable motion beside one on a cliff: below a fold it is one of two."""
    values, vectors = np.linalg.eig(motion.slope / scale[:, None] * scale)
    leading = vectors[:, int(np.argmax(np.abs(values)))].real
    tried = (solve(returns, motion.section + part * leading * scale).motion for part in (0.0, 0.1, -0.1, 0.05, -0.05))
    return next(each.section for each in tried if each is not None and each.stability_margin > 0.0)


def test_the_cliff_finder_ends_on_the_curve(bench_curve: tuple[Integration, tuple[Bifurcation, ...]]) -> None:
    integration, curve = bench_curve
    for point in curve[2:-1:6]:
        if point.loss is Loss.BEATING:  # from a fold two motions lead down
            conditions = point.motion.conditions
            below = raised(integration, point.motion, 0.99 * conditions.height)
            assert below is not None
            cliff = find_cliff(integration, below, 1.5 * conditions.height, 1e-3, 1e-7)
            assert cliff.height == pytest.approx(conditions.height, rel=2e-5)
            assert cliff.loss is point.loss


def test_near_grazing_the_largest_multiplier_grows_as_one_over_the_speed_of_the_touch() -> None:
    """The root of the depth of the touch is in proportion to its speed: the square-root singularity of the map."""
    integration = bench(fidelity="impact")
    branch = follow_branch(integration, motion_of(integration, 0.01, 0.19), BENCH_HEIGHTS)
    assert [each.loss for each in branch.bifurcations[:2]] == [Loss.BEATING, Loss.FOLD]
    assert [each.ends_stability for each in branch.bifurcations[:2]] == [True, False]
    slowest = np.array([each.impacts[:, 2].min() for each in branch.motions[-6:]])
    largest = np.array([each.largest_multiplier for each in branch.motions[-6:]])
    assert slowest[-1] < 0.2 * slowest[0] < 0.02
    assert np.polyfit(np.log(slowest), np.log(largest), 1)[0] == pytest.approx(-1.0, abs=0.02)
    assert slowest * largest == pytest.approx(np.full(6, slowest[-1] * largest[-1]), rel=0.05)


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


def test_the_command_writes_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, picture = tmp_path / "c.csv", tmp_path / "c.png"
    command = ["cliffs", "scenes/standard.yaml", "--height", "0.19:0.3", "--amplitudes", "0.0095:0.0105"]
    assert main([*command, "--json", "--out", str(out), "--picture", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == sum(len(part) for part in found.values())
    assert [each["what"] for each in found["bifurcation"]][:2] == ["beating", "fold"]
    assert [found["cliff"][k]["amplitude"] for k in (0, -1)] == pytest.approx([0.0095, 0.0105])
    assert sum(map(len, numbers_in(picture).values())) == 5  # stable, unstable, beating, fold; the cliff
    assert main(command) == 0
    assert "mm  beating: the stable motion ends" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("standard.yaml --height 0.19:0.3 --frequencies 6:7", "excitation.frequency: given 5.46997; its cliff"),
        ("standard.yaml --height 0.017:0.3", "at 0.017 m there is no motion to follow"),
        ("free_decay.yaml --height 0.19:0.3", "no motion to follow: excitation or ceiling change until the end"),
    ],
)
def test_what_cannot_be_followed_is_one_line(line: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cliffs", *f"scenes/{line}".split()]) in (2, 3)
    assert words in capsys.readouterr().err
