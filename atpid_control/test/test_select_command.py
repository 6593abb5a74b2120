# SPDX-License-Identifier: Apache-2.0
"""`select` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from atpid_control.cli import main

ROOT = Path(__file__).parents[2]
SCENE = str(ROOT / "scenes" / "thesis_4_3.yaml")
MAP = str(ROOT / "atpid_control" / "config" / "maps" / "standard.npz")


@pytest.mark.parametrize("method", ["lookup", "pca", "direct", "search"])
def test_json_is_one_object_and_nothing_else(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    extra = ["--map", MAP] if method == "lookup" else []
    assert main(["select", SCENE, "--method", method, "--json", *extra]) == 0
    output = capsys.readouterr()
    chosen = json.loads(output.out)
    assert output.err == ""
    assert chosen["method"] == method
    # the scene ends at 0.03 m
    assert chosen["height"] == pytest.approx(0.57, rel=0.06)
    assert chosen["amplitude"] == pytest.approx(0.128, rel=0.03)
    assert chosen["efficiency"] == pytest.approx(0.807, abs=0.01)
    assert chosen["wall_s"] >= 0.0
    assert chosen["evaluations"] >= 0


def test_for_people_every_stage_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["select", SCENE, "--method", "pca", "--without-gravity"]) == 0
    text = capsys.readouterr().out
    assert "SM + PM1" in text
    assert "tuning 1" in text


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["select", "none.yaml", "--method", "pca"], "none.yaml"),
        (["select", str(ROOT / "scenes" / "free_decay.yaml"), "--method", "direct"], "a height is selected for a tone"),
        (["select", SCENE, "--method", "direct", "--without-gravity"], "allowed with pca"),
        (["select", SCENE, "--method", "direct", "--margin", "-1"], "margin"),
        (["select", SCENE, "--method", "lookup", "--map", SCENE], "is not a height map"),
    ],
)
def test_bad_input_is_one_line_and_status_two(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert named in output.err


def test_a_numerical_failure_is_status_three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # so large a swing presses the grain deeper into a wall than its radius
    scene = tmp_path / "huge.yaml"
    text = (ROOT / "scenes" / "standard.yaml").read_text(encoding="utf-8")
    scene.write_text(text.replace("amplitude: 0.01", "amplitude: 3.0"), encoding="utf-8")
    assert main(["select", str(scene), "--method", "direct"]) == 3
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "deeper into a wall than its radius" in error
