# SPDX-License-Identifier: Apache-2.0
"""The commands as a user calls them: output, exit status, errors in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.cli import main
from atpid_sim.maps import HeightMap

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = str(SCENES / "standard.yaml")


def test_simulate_prints_one_object_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", STANDARD, "--json"]) == 0
    output = capsys.readouterr()
    result = json.loads(output.out)
    assert output.err == ""
    assert result["amplitude"] == pytest.approx(0.0456498856, rel=2e-6)
    keys = "undamped_amplitude efficiency motion impacts fidelity error_estimate reproducible energy_residual"
    assert {*keys.split(), "wall_s", "result"} <= set(result)


def test_simulate_without_json_is_a_table_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", STANDARD, "--fidelity", "impact"]) == 0
    text = capsys.readouterr().out
    assert "amplitude" in text
    assert "the duration and depth of contacts" in text
    assert "default: seed" in text


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["simulate", "none.yaml"], "none.yaml"),
        (["map", STANDARD, "--amplitudes", "0.1:0.01:5", "--mass-fractions", "0.1", "--out", "m.npz"], "A0:A1:N"),
        (["map", STANDARD, "--amplitudes", "1:2", "--mass-fractions", "0.1", "--out", "m.npz"], "A0:A1:N"),
        (["map", STANDARD, "--amplitudes", "1:2:3", "--mass-fractions", "0.1,x", "--out", "m.npz"], "--mass-fractions"),
        (["map", STANDARD, "--amplitudes", "1:2:3", "--mass-fractions", "1.5", "--out", "m.npz"], "--mass-fractions"),
    ],
)
def test_bad_input_is_one_line_and_status_two(
    arguments: list[str],
    named: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert named in output.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [[], ["fly"], ["simulate"], ["simulate", STANDARD, "--rtol", "2"]])
def test_a_command_that_does_not_parse_is_status_two(arguments: list[str]) -> None:
    assert main(arguments) == 2


def test_a_rung_that_cannot_take_the_scene_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "hard.yaml"
    scene.write_text(
        Path(STANDARD)
        .read_text()
        .replace("tsuji, young_modulus: 2.1e8, poisson_ratio: 0.2, damping_ratio: 1.0", "impact, restitution: 0.15")
    )
    assert main(["simulate", str(scene), "--fidelity", "soft"]) == 2
    assert "no force to integrate" in capsys.readouterr().err


def test_map_writes_a_map_and_a_header(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, header = tmp_path / "map.npz", tmp_path / "table.h"
    arguments = ["map", STANDARD, "--amplitudes", "0.01:0.02:3", "--mass-fractions", "0.1", "--out", str(out)]
    assert main([*arguments, "--header", str(header)]) == 0
    output = capsys.readouterr()
    assert "3 best heights" in output.out
    assert "3/3" in output.err
    assert np.allclose(HeightMap.load(out).amplitudes, [0.01, 0.015, 0.02])
    assert "#define ATPID_TABLE_N 3" in header.read_text()
