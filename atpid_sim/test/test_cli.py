# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands as a user calls them: output, exit status, errors in one line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from sim_program import main
from sim_refusals import command_refused, has_parts

from atpid_common.testing import test_every_file_has_its_notice  # noqa: F401  # is a test here too

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
    for wrong in ([], ["fly"], ["simulate"], ["simulate", STANDARD, "--rtol", "2"]):
        assert main(wrong) == 2


def edited(tmp_path: Path, old: str, new: str, scene: str = "standard") -> str:
    """Write a scene with a piece of its text replaced; return its path."""
    text = (SCENES / f"{scene}.yaml").read_text()
    assert old in text
    (tmp_path / "edited.yaml").write_text(text.replace(old, new))
    return str(tmp_path / "edited.yaml")


def test_a_controlled_ceiling_is_refused_without_a_height(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "thesis_4_3.yaml")
    command_refused(capsys, ["simulate", scene, "--json"], 2, "(lookup)", "bench", "--height")
    assert main(["simulate", scene, "--json", "--height", "0.57"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["efficiency"] == pytest.approx(0.81, abs=0.005)
    assert output.err == ""


def test_an_unusual_value_is_run_and_named_with_the_usual(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = edited(tmp_path, "amplitude: 0.01", "amplitude: 10")
    assert main(["simulate", scene, "--fidelity", "simplified", "--json"]) == 0
    output = capsys.readouterr()
    warned = json.loads(output.out)["warnings"]
    has_parts(warned[0], ("excitation", "amplitude", "10 m", "1e-06", "0.2 m"))
    assert output.err == ""
    assert main(["simulate", scene, "--fidelity", "simplified"]) == 0
    assert f"warning: {warned[0]}" in capsys.readouterr().out
    command = ["simulate", scene, "--fidelity", "soft", "--height", "10"]
    command_refused(capsys, command, 3, "deeper", "radius", "excitation", "amplitude", "10 m")


def test_a_free_decay_is_measured_by_its_decrement(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(SCENES / "free_decay.yaml"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["decrement"] == pytest.approx(1.7703, rel=1e-4)
    assert result["undamped_decrement"] == pytest.approx(1.3098, rel=1e-4)
    assert 0.0 < result["decrement_error"] < 1e-5
    assert result["motion"] != "irregular"


def test_the_motion_is_written_and_can_drive_another_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, arrays = tmp_path / "new" / "run.csv", tmp_path / "run.npz"
    assert main(["simulate", STANDARD, "--series", str(table), "--rate", "500"]) == 0
    header, *rows = table.read_text().splitlines()
    assert header.split(",")[:3] == ["time", "support_displacement", "beam_displacement"]
    assert len(rows) == 8001
    window = np.loadtxt(table, delimiter=",", skiprows=1)[7000:, 2]
    assert 0.5 * np.ptp(window) == pytest.approx(0.04565, rel=2e-3)
    driven = edited(tmp_path, "{amplitude: 0.01, frequency: resonance}", f"{{series: {{file: {table}}}}}")
    assert main(["simulate", driven, "--json", "--series", str(arrays)]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["amplitude"] == pytest.approx(0.04565, rel=1e-3)
    with np.load(arrays) as kept:
        assert len(kept["impacts"]) > 100
        assert len(kept["time"]) == 16001


def test_an_amplitude_that_cannot_be_computed_costs_no_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, header = tmp_path / "map.npz", tmp_path / "table.h"
    arguments = ["map", STANDARD, "--amplitudes", "0.05:0.25:3", "--mass-fractions", "0.1", "--out", str(out)]
    assert main([*arguments, "--header", str(header)]) == 0
    output = capsys.readouterr()
    assert re.search("2.*3.*0.15", output.out)
    assert re.search("--amplitudes.*0.25", output.err)
    with np.load(out) as stored:
        assert np.isnan(stored["heights"]).tolist() == [[False, True, True]]
    assert header.read_text().count(", 0, 0}") == 1


@pytest.mark.parametrize(
    ("option", "target", "parts"),
    [
        ("--series", "run.txt", ".csv .npz"),
        ("--series", "file/run.csv", "file --series"),
        ("--picture", ".", ".png"),
        ("--picture", "mine.png", "mine.png exists --picture --force"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_run(
    option: str, target: str, parts: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "mine.png").write_text("mine")
    command_refused(capsys, ["simulate", STANDARD, option, str(tmp_path / target)], 2, *parts.split())


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("simulate none.yaml", "none.yaml"),
        (f"map {STANDARD} --amplitudes 0.1:0.01:5 --mass-fractions 0.1 --out m.npz", "A0:A1:N"),
        (f"map {STANDARD} --amplitudes 1:2 --mass-fractions 0.1 --out m.npz", "A0:A1:N"),
        (f"map {STANDARD} --amplitudes 1:2:3 --mass-fractions 0.1,x --out m.npz", "--mass-fractions"),
        (f"map {STANDARD} --amplitudes 1:2:3 --mass-fractions 1.5 --out m.npz", "--mass-fractions"),
    ],
)
def test_bad_input_is_one_line_and_status_two(
    command: str, named: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command_refused(capsys, command.split(), 2, named)
    assert list(tmp_path.iterdir()) == []
