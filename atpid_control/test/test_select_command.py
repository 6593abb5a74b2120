# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`select` as a user calls it."""

import re
from pathlib import Path

import pytest
from commands_run import answered, printed, refusal

from atpid_sim.scene import standard_bench

ROOT = Path(__file__).parents[2]
SCENE = str(ROOT / "scenes" / "thesis_4_3.yaml")
MAP = {"lookup": ["--map", str(ROOT / "atpid_control" / "config" / "maps" / "standard.npz")]}
METHODS = ["lookup", "pca", "direct", "search"]
Capture = pytest.CaptureFixture[str]


def changed(path: Path, old: str, new: str, of: str = SCENE) -> Path:
    """Return a file with a scene in which what matches a pattern is replaced."""
    text, count = re.subn(old, new, Path(of).read_text(encoding="utf-8"))
    assert count == 1
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("method", METHODS)
def test_json_is_one_object_and_nothing_else(method: str, tmp_path: Path, capsys: Capture) -> None:
    given = [] if method == "lookup" else ["--method", method]  # it is the scene's controller
    chosen = answered(capsys, "select", SCENE, *given, *MAP.get(method, []))
    assert chosen["method"] == method
    # the scene ends at 0.03 m
    assert chosen["height"] == pytest.approx(0.57, rel=0.06)
    assert chosen["amplitude"] == pytest.approx(0.128, rel=0.03)
    assert chosen["efficiency"] == pytest.approx(0.807, abs=0.01)
    assert chosen["warnings"] == []
    assert chosen["resonance"] == pytest.approx(5.47, abs=0.001)
    # where the grain begins is no matter
    begun = standard_bench(ceiling={"height": 0.2}, initial={"grain_height": 0.05})
    (tmp_path / "scene.yaml").write_text(begun.to_yaml())
    chosen = answered(capsys, "select", tmp_path / "scene.yaml", "--method", method)
    assert chosen["height"] == pytest.approx(0.2, rel=0.06)


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


@pytest.mark.parametrize(
    ("frequency", "bare", "efficiency", "reduction"),
    [(6.4, 0.0095, 0.536, -0.33), (6.64, 0.0132, 0.848, -0.04), (7.2, 0.0834, 0.178, 0.89), (7.6, 0.0171, 0.055, 0.65)],
)
def test_the_structure_as_it_is_without_the_damper_is_the_second_reference(
    frequency: float, bare: float, efficiency: float, reduction: float, tmp_path: Path, capsys: Capture
) -> None:
    """Where the efficiency is largest the damper makes it worse; where it is best the efficiency is 6 to 18 %."""
    (tmp_path / "plate.yaml").write_text(PLATE % frequency)
    chosen = answered(capsys, "select", tmp_path / "plate.yaml", "--method", "direct")
    assert chosen["bare_amplitude"] == pytest.approx(bare, rel=0.01)
    assert chosen["efficiency"] == pytest.approx(efficiency, abs=0.01)
    assert chosen["reduction"] == pytest.approx(reduction, abs=0.01)
    assert any("without" in line for line in chosen["warnings"]) == (reduction < 0.0)


@pytest.mark.parametrize(
    ("scene", "options", "line"),
    [
        ("none.yaml", ["--method", "pca"], r"none\.yaml"),
        ("standard.yaml", [], r"^error: --method: "),
        ("free_decay.yaml", ["--method", "direct"], r"free.* tone"),
        ("thesis_4_3.yaml", ["--method", "direct", "--without-gravity"], r"--without-gravity: .*direct; .*pca$"),
        ("thesis_4_3.yaml", ["--method", "direct", "--margin", "-1"], r"--margin: .*-1"),
        ("thesis_4_3.yaml", ["--method", "lookup", "--map", SCENE], r"thesis_4_3\.yaml.* NPZ"),
    ],
)
def test_bad_input_is_one_line_and_status_two(scene: str, options: list[str], line: str, capsys: Capture) -> None:
    assert re.search(line, refusal(capsys, "select", ROOT / "scenes" / scene, *options))


@pytest.mark.parametrize("options", ["direct", "direct --margin 3 --amplitude-std 1e-5 --deadline 1e-3", "pca"])
def test_a_height_of_no_use_is_reported_and_failure_is_status_3(options: str, tmp_path: Path, capsys: Capture) -> None:
    below = changed(tmp_path / "below.yaml", "amplitude: 0.01", "amplitude: 0.0003", str(ROOT / "scenes/standard.yaml"))
    chosen = answered(capsys, "select", below, "--method", *options.split())
    assert chosen["height"] == 0.017
    assert chosen["no_use"].endswith("closed")
    # so large a swing presses the grain deeper into a wall than its radius
    huge = changed(tmp_path / "huge.yaml", "amplitude: 0.0003", "amplitude: 3.0", str(below))
    assert "wall" in refusal(capsys, "select", huge, "--method", options.split()[0], status=3)


@pytest.mark.parametrize("method", ["lookup", "direct", "pca"])
def test_a_height_beyond_the_ceiling_s_range_is_a_warning(method: str, tmp_path: Path, capsys: Capture) -> None:
    short = changed(tmp_path / "short.yaml", r"\[0\.017, 1\.0\]", "[0.017, 0.3]")
    command = ["select", short, "--method", method, *MAP.get(method, [])]
    chosen = answered(capsys, *command)
    (warning,) = (line for line in chosen["warnings"] if "ceiling.range" in line)
    assert "(0.017 to 0.3 m)" in warning
    assert ("beyond" if method == "lookup" else f"`{method}`") in warning
    assert f"warning: {warning}" in printed(capsys, *command)
