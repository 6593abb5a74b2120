# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Designs for structures of several modes and under a force: closed forms, the box, the file, bad input."""

import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands_run import answered, printed, refusal
from scipy.linalg import eigh

from atpid_control.cli import main
from atpid_design import make
from atpid_design import problem as parts
from atpid_design.command import structure_in
from atpid_design.make import promised
from atpid_design.problem import Problem, case, deviation, problem_of, scene_of
from atpid_design.tuned_mass import TunedBeam, Tuning, over
from atpid_design.worst_case import bare_range
from atpid_sim.maps import DamperResponse
from atpid_sim.robust import corners, inside

FURTHER = {"mass": 6.0, "frequency": 60.0, "damping_ratio": 0.02, "drive_factor": -0.5}
BRACKET = f"""
beam: {{mass: 2.0, frequency: 15.0, damping_ratio: 0.02}}
further_modes:
- {json.dumps(FURTHER)}
drive: force
"""
OWN = 2.0 * math.pi * 15.0


def bracket(**changes: Any) -> Problem:
    beam = {"mass": 2.0, "frequency": 15.0, "damping": 0.02}
    return problem_of(**(beam | {"amplitudes": (10.0, 30.0), "further_modes": [FURTHER], "drive": "force"} | changes))


def matrices(grain: float = 0.0, tuned: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[np.ndarray]:
    """Return mass, damping, stiffness and force of the bracket with a mass at its container, and a tuned one there.

    tuned: its mass, damping and stiffness.
    """
    mass, own = np.array([2.0, 6.0]), 2.0 * np.pi * np.array([15.0, 60.0])
    made = [np.zeros((3, 3)) for _ in range(3)]
    for matrix, one in zip(made, (mass, 2.0 * 0.02 * mass * own, mass * own**2), strict=True):
        matrix[:2, :2] = np.diag(one)
    made[0][:2, :2] += grain
    link = np.array([[1.0, 1.0, -1.0]])
    made[0][2, 2] = tuned[0]
    return [made[0], made[1] + tuned[1] * link.T @ link, made[2] + tuned[2] * link.T @ link, np.array([1.0, -0.5, 0.0])]


def moved(system: list[np.ndarray], omega: float, count: int) -> np.ndarray:
    """Return how far the first coordinates move under a unit of the force."""
    m, c, k, f = system
    dynamic = (k - omega**2 * m + 1j * omega * c)[:count, :count]
    return np.asarray(np.linalg.solve(dynamic, f[:count]))


def test_resonance_and_references_are_those_of_the_matrices() -> None:
    problem, fraction = bracket(), 0.2
    m, c, k = (matrix[:2, :2] for matrix in matrices(0.5)[:3])
    squares, shapes = eigh(k, m)
    assert parts.resonance(problem, fraction) == pytest.approx(math.sqrt(squares[0]) / (2.0 * math.pi), rel=1e-12)
    assert parts.time_constant(problem, fraction) == pytest.approx(2.0 / (shapes[:, 0] @ c @ shapes[:, 0]), rel=1e-12)
    one, omega = case(problem, fraction, frequency=13.0), 2.0 * math.pi * 13.0
    assert one.bare(20.0) == pytest.approx(20.0 * abs(moved(matrices(), omega, 2).sum()), rel=1e-12)
    # the damping between joined modes is left out (docs/modes.md)
    closed = 20.0 * abs(moved(matrices(0.5), omega, 2).sum())
    assert one.damper.closed_amplitude(20.0) == pytest.approx(closed, rel=2e-3)


def test_a_tuned_mass_on_two_modes_is_that_of_the_matrices() -> None:
    modes, tuned = parts.modes_of(bracket(), 0.2), 0.5
    assert modes is not None
    beam = TunedBeam(0.25, 0.02, Tuning(0.85, 0.15), over(modes.free, 2.0, 15.0))
    system = matrices(tuned=(tuned, 2.0 * tuned * OWN * 0.15, tuned * (0.85 * OWN) ** 2))
    for ratio in (0.7, 0.9, 1.0, 3.9):
        found = moved(system, ratio * OWN, 3)
        assert float(beam.beam(ratio)) == pytest.approx(abs(found[0] + found[1]), rel=1e-10)
        assert float(beam.stroke(ratio)) == pytest.approx(abs(found[0] + found[1] - found[2]), rel=1e-10)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"excitation_frequency": (14.0, 15.0)},
        {"further_modes": [], "drive": "support", "amplitudes": (0.001, 0.004)},
        {"further_modes": [], "drive": "support", "amplitudes": (0.001, 0.004), "excitation_frequency": (14.0, 15.0)},
    ],
)
def test_the_amplitude_of_today_spans_what_is_drawn(changes: dict[str, Any]) -> None:
    problem, rng = bracket(**changes), np.random.default_rng(4)
    low, high = bare_range(problem, 0.2, 20.0)
    for point in np.vstack([inside(40, problem.quantities, 3), corners(problem.quantities)]):
        at = float(rng.uniform(14.0, 15.0)) if "excitation_frequency" in changes else None
        bare = case(problem, 0.2, deviation(problem, point), frequency=at).bare(20.0)
        assert low * 0.98 < bare < high * 1.02
    assert bare_range(problem, 0.2, 40.0) == pytest.approx((2.0 * low, 2.0 * high))


def test_each_mode_has_deviations_of_its_own() -> None:
    problem = bracket()
    assert problem.quantities == 11
    assert np.array_equal(corners(11).T @ corners(11), 16.0 * np.eye(11))
    point = np.zeros(11)
    point[8:] = 1.0, -1.0, 1.0
    changed = scene_of(problem, 0.2, 20.0, 0.08, deviation(problem, point))
    (mode,), own = changed.further_modes, 2.0 * math.pi * 60.0 * 0.98
    assert mode.mass == pytest.approx(6.0 * 1.02)
    assert mode.stiffness == pytest.approx(6.0 * 1.02 * own**2)
    assert mode.damping == pytest.approx(2.0 * 0.022 * 6.0 * 1.02 * own)
    assert changed.beam == scene_of(problem, 0.2, 20.0, 0.08).beam
    box = corners(20)  # more quantities than columns share them
    assert box.shape == (16, 20)
    assert np.array_equal(box[:, 8:13], box[:, 15:20])


def test_a_mode_that_hardly_moves_changes_nothing() -> None:
    """A second mode of 250 000 times the mass and no drive: the design of one mode, found by other code."""
    one = problem_of(mass=2.0, frequency=15.0, damping=0.02, amplitudes=(0.002, 0.003))
    heavy = {"mass": 5e5, "frequency": 60.0, "damping_ratio": 0.02}
    two = problem_of(**one.model_dump(exclude={"further_modes"}), further_modes=[heavy])
    for a, b in zip(*(promised(problem, 0.2, amplitudes=2)[1] for problem in (one, two)), strict=True):
        assert b.height == pytest.approx(a.height, rel=0.01)
        assert b.beam_amplitude.expected == pytest.approx(a.beam_amplitude.expected, rel=0.01)
        assert b.ceiling_force.expected == pytest.approx(a.ceiling_force.expected, rel=0.03)


def test_a_file_of_a_structure_is_that_of_the_options(tmp_path: Path) -> None:
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    read = Problem(**structure_in(tmp_path / "bracket.yaml"), amplitudes=(10.0, 30.0))
    assert read.drive == "force"
    assert (read.mass, read.frequency, read.damping) == pytest.approx((2.0, 15.0, 0.02))
    assert read.further_modes == bracket().further_modes
    # the restitution is against the mass that an impulse meets
    scene = scene_of(bracket(restitution=0.4), 0.2, 20.0, 0.08)
    assert DamperResponse(scene).restitution(20.0) == pytest.approx(0.4, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("--mass 2", ["structure", "--mass", "--structure", "--frequency"]),
        ("--structure GIVEN --mass 2", ["--structure", "--mass", "alone"]),
        ("--structure GIVEN --drive force", ["--structure", "--drive", "alone"]),
        ("--structure BAD", ["--structure", "bad.yaml", "beam.mass", "-2.0", "1e-06 to 1e+06"]),
        ("--structure NONE", ["--structure", "none.yaml"]),
        ("--structure GIVEN --amplitudes 10:2000", ["--amplitudes", "10:2000", "LO:HI"]),
        ("--mass 2 --frequency 15 --damping 0.02", ["--amplitudes", "10:30", "LO:HI"]),
    ],
)
def test_a_bad_structure_is_one_line(
    given: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given.yaml").write_text(BRACKET)
    (tmp_path / "bad.yaml").write_text(BRACKET.replace("mass: 2.0", "mass: -2.0"))
    options = [str(tmp_path / f"{word.lower()}.yaml") if word.isupper() else word for word in given.split()]
    amplitudes = [] if "--amplitudes" in options else ["--amplitudes", "10:30"]
    line = refusal(capsys, "design", *options, *amplitudes, "--out", tmp_path / "out")
    assert line.startswith(f"error: {words[0]}: ")
    assert [word for word in words if word not in line] == []


def test_a_design_is_made_and_its_scene_simulates_and_selects(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # files are looked at, for which two amplitudes and a coarse picture do
    monkeypatch.setattr(make, "promised", partial(promised, amplitudes=2))
    monkeypatch.setattr(make, "_FOR_TRADE", 2)
    monkeypatch.setattr(make, "_LANDSCAPE", 4)
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    out = tmp_path / "out"
    options = ["--amplitudes", "15:30", "--max-mass-fraction", "0.02", "--out", str(out)]
    assert main(["design", "--structure", str(tmp_path / "bracket.yaml"), *options]) == 0
    capsys.readouterr()
    plain = json.loads((out / "design.json").read_text(encoding="utf-8"))
    assert plain["problem"]["drive"] == "force"
    assert plain["points"][-1]["amplitude"] == 30.0
    # the scene is one of the structure, and its height is the design's
    assert "efficiency" in answered(capsys, "simulate", out / "scene.yaml", "--height", "0.06")
    assert "height" in printed(capsys, "select", out / "scene.yaml", "--method", "lookup")
