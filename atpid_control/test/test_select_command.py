# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`select` as a user calls it."""

import json
import re
from pathlib import Path

import pytest

from atpid_control.cli import main
from atpid_control.selection import map_cache as maps
from atpid_sim.scene import standard_bench

ROOT = Path(__file__).parents[2]
SCENE = str(ROOT / "scenes" / "thesis_4_3.yaml")
MAP = str(ROOT / "atpid_control" / "config" / "maps" / "standard.npz")


@pytest.mark.parametrize("method", ["lookup", "pca", "direct", "search", "learned"])
def test_json_is_one_object_and_nothing_else(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    extra = ["--map", MAP] if method == "lookup" else []
    assert main(["select", SCENE, "--method", method, "--json", *extra]) == 0
    output = capsys.readouterr()
    chosen = json.loads(output.out)
    assert output.err == ""
    assert chosen["method"] == method
    # the scene ends at 0.03 m
    assert chosen["height"] == pytest.approx(0.57, rel=0.06)
    # learned stays below the best on purpose
    assert chosen["amplitude"] == pytest.approx(0.128, rel=0.05 if method == "learned" else 0.03)
    assert chosen["efficiency"] == pytest.approx(0.807, abs=0.01)
    assert chosen["wall_s"] >= 0.0
    assert chosen["evaluations"] >= 0


#: A floor plate of 7.2 Hz and 38 kg, whose machine shakes it at 6.4 Hz (docs/design.md).
PLATE = """
beam: {mass: 38, stiffness: 77770.0, damping: 41.26}
grain: {mass_fraction: 0.15, radius: 0.0589}
contact: {law: tsuji, young_modulus: 2.1e8, poisson_ratio: 0.2, damping_ratio: 1.0}
excitation: {amplitude: 0.002, frequency: %s}
ceiling: {height: 0.2}
gravity: 9.81
duration: 16.0
steady_window: [14.0, 16.0]
tolerance: 1.0e-6
"""


@pytest.mark.parametrize(("frequency", "bare", "efficiency", "reduction"), [
    (6.4, 0.0095, 0.536, -0.33), (6.64, 0.0132, 0.848, -0.04), (7.2, 0.0834, 0.178, 0.89), (7.6, 0.0171, 0.055, 0.65),
])  # fmt: skip
def test_the_structure_as_it_is_without_the_damper_is_the_second_reference(
    frequency: float, bare: float, efficiency: float, reduction: float, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Where the efficiency is largest the damper makes it worse; where it is best the efficiency is 6 to 18 %."""
    (tmp_path / "plate.yaml").write_text(PLATE % frequency)
    assert main(["select", str(tmp_path / "plate.yaml"), "--method", "direct", "--json"]) == 0
    chosen = json.loads(capsys.readouterr().out)
    assert chosen["bare_amplitude"] == pytest.approx(bare, rel=0.01)
    assert chosen["efficiency"] == pytest.approx(efficiency, abs=0.01)
    assert chosen["reduction"] == pytest.approx(reduction, abs=0.01)
    assert any("more than it does without the damper" in line for line in chosen["warnings"]) == (reduction < 0.0)


def test_for_people_every_stage_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["select", SCENE, "--method", "pca", "--without-gravity"]) == 0
    text = capsys.readouterr().out
    assert "SM + PM1" in text
    assert "tuning 1" in text


@pytest.mark.parametrize("method", ["lookup", "pca", "direct", "search", "learned"])
def test_where_the_grain_begins_is_no_matter(method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = standard_bench(ceiling={"height": 0.2}, initial={"grain_height": 0.05})
    (tmp_path / "scene.yaml").write_text(scene.to_yaml())
    assert main(["select", str(tmp_path / "scene.yaml"), "--method", method, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["height"] == pytest.approx(0.2, rel=0.06)


def test_the_method_is_by_default_the_controller_of_the_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["select", SCENE, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["method"] == "lookup"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["select", "none.yaml", "--method", "pca"], "none.yaml"),
        (["select", str(ROOT / "scenes" / "standard.yaml")], "--method: not given, and the scene's ceiling has no"),
        (["select", str(ROOT / "scenes" / "free_decay.yaml"), "--method", "direct"], "a height is selected for a tone"),
        (["select", SCENE, "--method", "direct", "--without-gravity"], "allowed with pca"),
        (["select", SCENE, "--method", "direct", "--margin", "-1"], "margin"),
        (["select", SCENE, "--method", "lookup", "--map", SCENE], "is no NPZ archive of arrays"),
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


def of_no_use(tmp_path: Path) -> str:
    scene = tmp_path / "below.yaml"
    text = (ROOT / "scenes" / "standard.yaml").read_text(encoding="utf-8")
    scene.write_text(text.replace("amplitude: 0.01", "amplitude: 0.0003"), encoding="utf-8")
    return str(scene)


@pytest.mark.parametrize(
    "arguments",
    [
        ["direct"],
        ["direct", "--margin", "3", "--amplitude-std", "1e-5"],
        ["direct", "--margin", "3", "--amplitude-std", "1e-5", "--deadline", "1e-3"],
        ["pca"],
    ],
    ids=" ".join,
)
def test_a_height_of_no_use_is_reported_however_it_is_asked_for(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["select", of_no_use(tmp_path), "--json", "--method", *arguments]) == 0
    chosen = json.loads(capsys.readouterr().out)
    assert chosen["height"] == 0.017
    assert "does not lift it; it stays closed" in chosen["no_use"]


def test_a_deadline_that_is_missed_is_announced(capsys: pytest.CaptureFixture[str]) -> None:
    hurried = ["select", SCENE, "--method", "direct", "--margin", "3", "--amplitude-std", "1e-4", "--deadline", "1e-3"]
    assert main([*hurried, "--json"]) == 0
    chosen = json.loads(capsys.readouterr().out)
    assert chosen["late"]
    assert "in 1 of 123 sampled systems" in chosen["note"]
    assert main(hurried) == 0
    assert "late: " in capsys.readouterr().out


def test_a_numerical_failure_is_status_three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # so large a swing presses the grain deeper into a wall than its radius
    scene = tmp_path / "huge.yaml"
    text = (ROOT / "scenes" / "standard.yaml").read_text(encoding="utf-8")
    scene.write_text(text.replace("amplitude: 0.01", "amplitude: 3.0"), encoding="utf-8")
    assert main(["select", str(scene), "--method", "direct"]) == 3
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "deeper into a wall than its radius" in error


def with_range(tmp_path: Path, high: float) -> str:
    scene = tmp_path / "short.yaml"
    text = Path(SCENE).read_text(encoding="utf-8")
    assert "[0.017, 1.0]" in text
    scene.write_text(text.replace("[0.017, 1.0]", f"[0.017, {high}]"), encoding="utf-8")
    return str(scene)


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("lookup", " m is beyond ceiling.range (0.017 to 0.3 m); the loop would send"),
        ("direct", "lies at the end of ceiling.range (0.017 to 0.3 m), in which `direct` selects"),
        ("pca", "lies at the end of ceiling.range (0.017 to 0.3 m), in which `pca` selects"),
    ],
)
def test_a_height_beyond_the_ceiling_s_range_is_a_warning(
    method: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    extra = ["--map", MAP] if method == "lookup" else []
    assert main(["select", with_range(tmp_path, 0.3), "--method", method, *extra]) == 0
    assert words in capsys.readouterr().out
    assert main(["select", with_range(tmp_path, 0.3), "--method", method, "--json", *extra]) == 0
    output = capsys.readouterr()
    assert [line for line in json.loads(output.out)["warnings"] if words in line]
    assert output.err == ""
    assert main(["select", SCENE, "--method", method, "--json", *extra]) == 0
    chosen = json.loads(capsys.readouterr().out)
    assert chosen["warnings"] == []
    assert chosen["resonance"] == pytest.approx(5.47, abs=0.001)


@pytest.mark.slow
def test_one_infeasible_amplitude_costs_no_look_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A small stiff beam: most amplitudes of the usual range press the grain too deep; the one asked for does not."""
    scene = tmp_path / "own.yaml"
    text = Path(SCENE).read_text(encoding="utf-8")
    text = text.replace(
        "{mass: 0.3258, stiffness: 427.6, damping: 0.56}", "{mass: 1.2, stiffness: 3.0e4, damping: 2.0}"
    )
    text = re.sub(r"amplitude: \[\[.*\]\]", "amplitude: 0.0005", text)
    scene.write_text(text.replace("tolerance:  1.0e-6", "tolerance:  1.0e-4"), encoding="utf-8")
    monkeypatch.setattr(maps, "user_cache", lambda: tmp_path / "maps")
    monkeypatch.setattr(maps, "_POINTS", 5)
    assert main(["select", str(scene), "--method", "lookup", "--json"]) == 0
    output = capsys.readouterr()
    looked_up = json.loads(output.out)
    assert "cannot be simulated: the map ends there" in output.err
    assert main(["select", str(scene), "--method", "direct", "--json"]) == 0
    direct = json.loads(capsys.readouterr().out)
    assert looked_up["efficiency"] == pytest.approx(direct["efficiency"], abs=0.02)
    assert main(["select", str(scene), "--method", "lookup", "--json"]) == 0
    assert capsys.readouterr().err == ""  # kept
