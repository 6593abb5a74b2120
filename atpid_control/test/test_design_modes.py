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
from scipy.linalg import eigh

from atpid_control.cli import main
from atpid_control.design import make
from atpid_control.design.make import promised
from atpid_control.design.problem import (
    Problem,
    case,
    deviation,
    modes_of,
    problem_of,
    resonance,
    scene_of,
    time_constant,
)
from atpid_control.design.structure_file import structure_in
from atpid_control.design.today import bare_range
from atpid_control.design.tuned_mass import TunedBeam, Tuning, over
from atpid_sim.maps import DamperResponse
from atpid_sim.robust import corners, inside

FURTHER = {"mass": 6.0, "frequency": 60.0, "damping_ratio": 0.02, "drive_factor": -0.5}
BRACKET = f"""
beam: {{mass: 2.0, frequency: 15.0, damping_ratio: 0.02}}
further_modes:
- {json.dumps(FURTHER)}
drive: force
"""


def bracket(**changes: Any) -> Problem:
    given = {
        "mass": 2.0, "frequency": 15.0, "damping": 0.02, "amplitudes": (10.0, 30.0), "further_modes": [FURTHER],
        "drive": "force",
    }  # fmt: skip
    return problem_of(**(given | changes))


def matrices(grain: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return mass, damping, stiffness and force of the bracket with a mass at its container."""
    mass, own = np.array([2.0, 6.0]), 2.0 * np.pi * np.array([15.0, 60.0])
    return np.diag(mass) + grain, np.diag(2.0 * 0.02 * mass * own), np.diag(mass * own**2), np.array([1.0, -0.5])


def amplitude_by_matrices(grain: float, frequency: float, force: float) -> float:
    m, c, k, f = matrices(grain)
    w = 2.0 * np.pi * frequency
    return float(abs(np.linalg.solve(k - w * w * m + 1j * w * c, force * f).sum()))


def test_resonance_and_references_are_those_of_the_matrices() -> None:
    problem, fraction = bracket(), 0.2
    m, c, k, _ = matrices(0.5)
    squares, shapes = eigh(k, m)
    assert resonance(problem, fraction) == pytest.approx(math.sqrt(squares[0]) / (2.0 * math.pi), rel=1e-12)
    assert time_constant(problem, fraction) == pytest.approx(2.0 / (shapes[:, 0] @ c @ shapes[:, 0]), rel=1e-12)
    one = case(problem, fraction, frequency=13.0)
    assert one.bare(20.0) == pytest.approx(amplitude_by_matrices(0.0, 13.0, 20.0), rel=1e-12)
    # the damping between joined modes is left out (docs/modes.md)
    assert one.damper.closed_amplitude(20.0) == pytest.approx(amplitude_by_matrices(0.5, 13.0, 20.0), rel=2e-3)


def test_the_amplitude_of_today_spans_what_is_drawn() -> None:
    for problem in (bracket(), bracket(excitation_frequency=(14.0, 15.0))):
        low, high = bare_range(problem, 0.2, 20.0)
        box = np.vstack([inside(40, problem.quantities, 3), corners(problem.quantities)])
        rng = np.random.default_rng(4)
        for point in box:
            at = None if problem.excitation_frequency is None else float(rng.uniform(14.0, 15.0))
            bare = case(problem, 0.2, deviation(problem, point), frequency=at).bare(20.0)
            assert low * 0.98 < bare < high * 1.02
        assert bare_range(problem, 0.2, 40.0) == pytest.approx((2.0 * low, 2.0 * high))


def test_each_mode_has_deviations_of_its_own() -> None:
    problem = bracket()
    assert problem.quantities == 11
    box = corners(11)
    assert np.array_equal(box.T @ box, 16.0 * np.eye(11))
    point = np.zeros(11)
    point[8:] = 1.0, -1.0, 1.0
    changed = scene_of(problem, 0.2, 20.0, 0.08, deviation(problem, point))
    (mode,), own = changed.further_modes, 2.0 * math.pi * 60.0 * 0.98
    assert mode.mass == pytest.approx(6.0 * 1.02)
    assert mode.stiffness == pytest.approx(6.0 * 1.02 * own**2)
    assert mode.damping == pytest.approx(2.0 * 0.022 * 6.0 * 1.02 * own)
    assert changed.beam == scene_of(problem, 0.2, 20.0, 0.08).beam


def test_more_quantities_than_columns_share_them() -> None:
    box = corners(20)
    assert box.shape == (16, 20)
    assert np.array_equal(box[:, 8:13], box[:, 15:20])


def test_the_restitution_is_against_the_mass_that_an_impulse_meets() -> None:
    scene = scene_of(bracket(restitution=0.4), 0.2, 20.0, 0.08)
    assert DamperResponse(scene).restitution(20.0) == pytest.approx(0.4, rel=1e-6)


def test_a_tuned_mass_on_two_modes_is_that_of_the_matrices() -> None:
    problem = bracket()
    modes = modes_of(problem, 0.2)
    assert modes is not None
    tuning = Tuning(0.85, 0.15)
    beam = TunedBeam(0.25, 0.02, tuning, over(modes.free, 2.0, 15.0))
    m, c, k, f = matrices(0.0)
    own, tuned = 2.0 * math.pi * 15.0, 0.5
    stiffness, damping = tuned * (0.85 * own) ** 2, 2.0 * tuned * own * 0.15
    link = np.array([[1.0, 1.0, -1.0]])
    both = np.block([[m, np.zeros((2, 1))], [np.zeros((1, 2)), np.array([[tuned]])]])
    springs = np.block([[k, np.zeros((2, 1))], [np.zeros((1, 3))]]) + stiffness * link.T @ link
    dampers = np.block([[c, np.zeros((2, 1))], [np.zeros((1, 3))]]) + damping * link.T @ link
    for ratio in (0.7, 0.9, 1.0, 3.9):
        w = ratio * own
        found = np.linalg.solve(springs - w * w * both + 1j * w * dampers, np.array([*f, 0.0]))
        assert float(beam.beam(ratio)) == pytest.approx(abs(found[0] + found[1]), rel=1e-10)
        assert float(beam.stroke(ratio)) == pytest.approx(abs(found[0] + found[1] - found[2]), rel=1e-10)


@pytest.mark.slow
def test_a_mode_that_hardly_moves_changes_nothing() -> None:
    """A second mode of 250 000 times the mass and no drive: the design of one mode, found by other code."""
    one = problem_of(mass=2.0, frequency=15.0, damping=0.02, amplitudes=(0.002, 0.003))
    heavy = {"mass": 5e5, "frequency": 60.0, "damping_ratio": 0.02}
    two = problem_of(**one.model_dump(exclude={"further_modes"}), further_modes=[heavy])
    _, alone, _ = promised(one, 0.2, amplitudes=2)
    _, beside, _ = promised(two, 0.2, amplitudes=2)
    for a, b in zip(alone, beside, strict=True):
        assert b.height == pytest.approx(a.height, rel=0.01)
        assert b.beam_amplitude.expected == pytest.approx(a.beam_amplitude.expected, rel=0.01)
        assert b.ceiling_force.expected == pytest.approx(a.ceiling_force.expected, rel=0.03)


def test_a_file_of_a_structure_is_that_of_the_options(tmp_path: Path) -> None:
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    read = Problem(**structure_in(tmp_path / "bracket.yaml"), amplitudes=(10.0, 30.0))
    assert read.drive == "force"
    assert (read.mass, read.frequency, read.damping) == pytest.approx((2.0, 15.0, 0.02))
    assert read.further_modes == bracket().further_modes


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (["--mass", "2"], "structure: given --mass; allowed: --structure FILE.yaml, or all of --mass --frequency"),
        (["--structure", "GIVEN", "--mass", "2"], "--structure: given beside --mass; allowed: the file alone, or"),
        (["--structure", "GIVEN", "--drive", "force"], "--structure: given beside --drive; allowed: the file alone"),
        (["--structure", "BAD"], "--structure: BAD: beam.mass: given -2.0; allowed: from 1e-06 to 1e+06"),
        (["--structure", "NONE"], "--structure: NONE: "),
        (
            ["--structure", "GIVEN", "--amplitudes", "10:2000"],
            "--amplitudes: given 10:2000; allowed: LO:HI, two rising",
        ),
        (["--mass", "2", "--frequency", "15", "--damping", "0.02"], "--amplitudes: given 10:30; allowed: LO:HI, two r"),
    ],
)
def test_bad_input_is_one_line(given: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {name: str(tmp_path / f"{name.lower()}.yaml") for name in ("GIVEN", "BAD", "NONE")}
    Path(files["GIVEN"]).write_text(BRACKET)
    Path(files["BAD"]).write_text(BRACKET.replace("mass: 2.0", "mass: -2.0"))
    options = [files.get(word, word) for word in given]
    amplitudes = [] if "--amplitudes" in options else ["--amplitudes", "10:30"]
    assert main(["design", *options, *amplitudes, "--out", str(tmp_path / "out")]) == 2
    for name, path in files.items():
        line = line.replace(name, path)
    printed = capsys.readouterr()
    assert printed.err.startswith(f"error: {line}")
    assert printed.err.count("\n") == 1


@pytest.mark.slow
def test_the_page_has_modes_and_newtons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # words and files are looked at, for which two amplitudes and a coarse picture do
    monkeypatch.setattr(make, "promised", partial(promised, amplitudes=2))
    monkeypatch.setattr(make, "_FOR_TRADE", 2)
    monkeypatch.setattr(make, "_LANDSCAPE", 4)
    (tmp_path / "bracket.yaml").write_text(BRACKET)
    options = ["--amplitudes", "15:30", "--max-mass-fraction", "0.05", "--out", str(tmp_path / "out")]
    assert main(["design", "--structure", str(tmp_path / "bracket.yaml"), *options]) == 0
    printed = capsys.readouterr().out
    assert "mode 2: 6 kg · 60 Hz" in printed
    assert "kicks of 0.1 m/s at a force of" in " ".join(printed.split())
    page = (tmp_path / "out" / "design.html").read_text(encoding="utf-8")
    for words in (
        "at a force of ±30 N",
        "force [N]",
        "2, each with mass, frequency and damping of its own",
        "force ±15 N",
    ):
        assert words in page
    assert "atpid bench" not in page
    plain = json.loads((tmp_path / "out" / "design.json").read_text(encoding="utf-8"))
    assert plain["problem"]["drive"] == "force"
    assert plain["points"][-1]["amplitude"] == 30.0
    # the scene is one of the structure, and its height is the design's
    assert main(["simulate", str(tmp_path / "out" / "scene.yaml"), "--height", "0.06", "--json"]) == 0
    assert main(["select", str(tmp_path / "out" / "scene.yaml"), "--method", "lookup", "--json"]) == 0
