# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Modes from dimensions and from universal files: closed forms, the thesis's beam, a round trip, what is refused."""

import functools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
import yaml
from commands_run import answered, printed, refusal

from atpid_lab.modes import cantilever
from atpid_lab.modes.cantilever import Cantilever
from atpid_lab.modes.structure import Structure, choose
from atpid_sim.scene import load_scene, standard_bench

#: Steel, bare, slender.
BARE = Cantilever(1.0, 500.0, 2.34)
#: Table 2.1, clamped over 0.4 m, bent as 427.6 N/m at the tip are, with a container of 0.25 kg.
THESIS = Cantilever(0.4, 427.6 * 0.4**3 / 3.0, 0.35 * 0.4 / 0.45, 0.25)
MATERIAL = "--modulus 5.345e9 --density 2431"
SHAPE = "modes cantilever --length 0.4 --width 0.04 --thickness 0.008 --tip-mass 0.25 --damping-ratio 0.024 --modes 3"
LINE = f"{SHAPE} {MATERIAL}".split()
Capture = pytest.CaptureFixture[str]


def test_a_bare_cantilever_is_that_of_the_books() -> None:
    """Roots of 1 + cos x cosh x; shape 2 at the tip for a modal mass of the beam's, so a quarter of it there."""
    structure = cantilever.modes_of(BARE, 3)
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349])
    pace = math.sqrt(BARE.bending_stiffness / (BARE.mass * BARE.length**3))
    # participation 2 sigma / x of a shape of modal mass 1, times the shape at the tip, 2 with alternating sign
    sigma = (np.sinh(roots) - np.sin(roots)) / (np.cosh(roots) + np.cos(roots))
    assert [mode.frequency for mode in structure.modes] == pytest.approx(roots**2 * pace / (2.0 * math.pi), rel=1e-6)
    assert [mode.mass for mode in structure.modes] == pytest.approx([BARE.mass / 4.0] * 4, rel=1e-6)
    expected = 4.0 * sigma / roots * [1, -1, 1, -1]
    assert [mode.base for mode in structure.modes] == pytest.approx(expected, rel=1e-4)
    assert structure.modes[0].base == pytest.approx(1.566, abs=5e-4)
    assert structure.modes[0].slope == pytest.approx(1.3765 / BARE.length, rel=1e-4)


@pytest.mark.parametrize("tip_mass", [0.0, 0.3])
def test_effective_masses_of_the_base_add_up_to_the_whole(tip_mass: float) -> None:
    structure = cantilever.modes_of(BARE._replace(tip_mass=tip_mass), 20)
    effective = np.cumsum([mode.base**2 * mode.mass for mode in structure.modes])
    whole = BARE.mass + tip_mass
    assert 0.97 * whole < effective[-1] < whole
    assert sum(mode.base for mode in structure.modes) == pytest.approx(1.0, abs=0.05)


def test_a_heavy_tip_mass_is_the_one_mass_of_rayleigh() -> None:
    beam = BARE._replace(tip_mass=100.0 * BARE.mass)
    first = cantilever.modes_of(beam, 1).modes[0]
    mass = beam.tip_mass + 33.0 / 140.0 * beam.mass
    stiffness = 3.0 * beam.bending_stiffness / beam.length**3
    assert first.frequency == pytest.approx(math.sqrt(stiffness / mass) / (2.0 * math.pi), rel=1e-5)
    assert first.mass == pytest.approx(mass, rel=1e-4)
    assert first.slope == pytest.approx(1.5 / beam.length, rel=1e-2)


def test_a_tip_inertia_lowers_the_frequency_as_a_body_that_turns() -> None:
    """A rigid body at the tip, no mass in the beam: two coordinates, whose flexibility is known."""
    beam = BARE._replace(mass=1e-6, tip_mass=2.0, tip_inertia=0.4)
    length, stiff = beam.length, beam.bending_stiffness
    flexible = np.array([[length**3 / 3.0, length**2 / 2.0], [length**2 / 2.0, length]]) / stiff
    squares = 1.0 / np.linalg.eigvals(flexible @ np.diag([beam.tip_mass, beam.tip_inertia]))
    expected = np.sort(np.sqrt(squares)) / (2.0 * math.pi)
    found = [mode.frequency for mode in cantilever.modes_of(beam, 1).modes]
    assert found == pytest.approx(expected, rel=1e-4)


def test_the_thesis_beam_has_the_modes_of_the_estimate() -> None:
    """5.78, 55.9, 174 Hz; 0.324, 2.39, 6.16 kg; 1.134, -0.177, 0.063, computed elsewhere with 40 elements."""
    modes = cantilever.modes_of(THESIS, 3).modes[:3]
    assert [mode.frequency for mode in modes] == pytest.approx([5.78, 55.9, 174.0], rel=1e-3)
    assert [mode.mass for mode in modes] == pytest.approx([0.324, 2.39, 6.16], rel=2e-3)
    assert [mode.base for mode in modes] == pytest.approx([1.134, -0.177, 0.063], abs=1e-3)
    lighter = cantilever.modes_of(THESIS._replace(tip_mass=0.15), 3).modes[:3]
    assert [mode.frequency for mode in lighter] == pytest.approx([6.95, 57.7, 176.0], rel=2e-3)
    assert [mode.mass for mode in lighter] == pytest.approx([0.225, 1.07, 2.52], rel=5e-3)


def motion(structure: Structure, count: int, frequency: float, force_at: float | None) -> complex:
    """Return the container's motion that a scene with the blocks has, for a unit of the base's motion or the force."""
    chosen = choose(structure, count, [0.01], forced=force_at is not None)
    modes = [chosen["blocks"]["beam"], *chosen["blocks"].get("further_modes", [])]
    mass, natural, factor = (
        np.array([one.get(key, 1.0) for one in modes]) for key in ("mass", "frequency", "drive_factor")
    )
    omega, own, damped = 2.0 * math.pi * frequency, 2.0 * math.pi * natural, 0.02j * math.pi * natural * 2.0
    if force_at is None:
        factor[0] = 1.0 - factor[1:].sum()
        drive = factor * mass * (own**2 + omega * damped)
    else:
        drive = factor * chosen["amplitude_factor"]
    return complex(np.sum(drive / (mass * (own**2 - omega**2 + omega * damped))))


@pytest.mark.parametrize("force_at", [None, 0.4, 0.25])
def test_the_blocks_move_the_container_as_many_modes_do(force_at: float | None) -> None:
    structure = cantilever.modes_of(THESIS, 20, force_at)
    for frequency in (2.0, 5.0, 12.0, 30.0):
        few, many = (motion(structure, count, frequency, force_at) for count in (3, 20))
        assert abs(few - many) < 2e-3 * abs(many)
    if force_at is not None:  # at rest: a (3 L - a) a / (6 E I), the beam's own deflection
        exact = force_at**2 * (3.0 * THESIS.length - force_at) / (6.0 * THESIS.bending_stiffness)
        assert abs(motion(structure, 20, 1e-6, force_at)) == pytest.approx(exact, rel=1e-4)


def test_what_is_left_out_is_stated() -> None:
    structure = cantilever.modes_of(THESIS, 20)
    chosen = choose(structure, 2, [0.01], forced=False)
    assert chosen["left_of_base"] == pytest.approx(1.0 - sum(mode.base for mode in structure.modes[:2]))
    assert chosen["left_of_compliance"] == pytest.approx(
        sum(1.0 / mode.stiffness for mode in structure.modes[2:]) / structure.compliance, rel=0.01
    )
    assert chosen["next_mode"] == structure.modes[2]._asdict()
    assert THESIS.tip_mass < choose(structure, 20, [0.01], forced=False)["impulse_mass"] < chosen["impulse_mass"]


def test_the_command_writes_blocks_that_it_explains(tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "beam.yaml"
    shown = printed(capsys, *LINE, "--out", out)
    assert out.read_text() == shown
    blocks = yaml.safe_load(shown)
    assert blocks["beam"] == pytest.approx({"mass": 0.3243, "frequency": 5.783, "damping_ratio": 0.024}, rel=1e-3)
    assert [one["drive_factor"] for one in blocks["further_modes"]] == pytest.approx([-0.1768, 0.0427], rel=2e-3)
    page = (Path(__file__).parents[3] / "docs/modes.md").read_text()
    documented = page.partition("```yaml\n")[2].partition("```")[0]
    numbers = [re.findall(r"-?[0-9]+(?:\.[0-9]+)?", text) for text in (documented, shown)]
    assert {"-0.02", "359.08"} <= set(numbers[1])  # of the base's motion left out; Hz of the next mode
    assert [*map(float, numbers[0])] == pytest.approx([*map(float, numbers[1])], rel=1e-3)
    steel, given = (f"{SHAPE} {words}".split() for words in ("--material steel", "--modulus 2.07e11 --density 7850"))
    assert printed(capsys, *steel) == printed(capsys, *given)
    assert "--material, " in refusal(capsys, *steel, "--density", "7850")
    found = answered(capsys, *LINE)
    assert found["blocks"] == blocks
    assert found["modes"][0]["stiffness"] == pytest.approx(428.2, rel=1e-3)
    driven = printed(capsys, *LINE, "--force-at", "0.3")
    assert yaml.safe_load(driven)["drive"] == "force"
    assert re.search(r"\bF\b.* 0\.63", driven)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("--damping-ratio 0.1 0.2", r"--damping-ratio: .*\b2; .*\b3\b"),
        ("--force-at 0.5", r"--force-at: .*0\.5 m; .*0\.4 m"),
        ("--force-at 1e-4", r"--force-at: .*5\.783 Hz"),
        ("--tip-mass 1e6", r"--modes: .*\b3; .*\b1\b"),
    ],
)
def test_dimensions_that_give_no_modes_are_one_line(words: str, line: str, capsys: Capture) -> None:
    assert re.search(line, refusal(capsys, *LINE, *words.split()))


@pytest.mark.parametrize(("words", "drive"), [("", "support"), ("--force-at 0.4", "force")])
def test_a_scene_gets_the_modes_and_keeps_its_grain(words: str, drive: str, tmp_path: Path, capsys: Capture) -> None:
    old = standard_bench(further_modes=[{"mass": 1.0, "frequency": 40.0, "damping_ratio": 0.1}], drive="force")
    (tmp_path / "old.yaml").write_text(old.to_yaml())
    printed(capsys, *LINE, *words.split(), "--scene", tmp_path / "old.yaml", "--out", tmp_path / "new.yaml")
    new = load_scene(tmp_path / "new.yaml")
    assert new.grain_mass == pytest.approx(old.grain_mass)
    assert new.beam.mass == pytest.approx(0.3243, rel=1e-3)
    assert [round(mode.mass, 2) for mode in new.further_modes] == [2.39, 6.15]
    assert (new.drive, new.ceiling) == (drive, old.ceiling)


@functools.cache
def shapes(count: int) -> tuple[Structure, Any]:
    """Return the thesis's beam and its shapes (modes, nodes) of modal mass 1 at 20 nodes beyond the clamp."""
    structure = cantilever.modes_of(THESIS, count)
    along = np.linspace(0.0, THESIS.length, 21)[1:]
    at = [cantilever.modes_of(THESIS, count, float(x)).modes for x in along]
    return structure, np.array([[one[k].force / math.sqrt(one[k].mass) for one in at] for k in range(count)])


def written(path: Path, count: int = 6, scale: float = 1.0, **changes: Any) -> Path:
    """Write a universal file of the thesis's beam, shapes in z; `scale` multiplies shapes, modal masses its square."""
    structure, values = shapes(6)
    for number in range(count):
        shape = np.asarray(changes.get("turn", 1.0) * scale * values[number])
        one: dict[str, Any] = {
            "type": 55, "model_type": 1, "data_ch": 2, "spec_data_type": 8, "load_case": 1, "mode_n": number + 1,
            "id1": "modes", "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE", "n_data_per_node": 3,
            "node_nums": np.arange(1, values.shape[1] + 1), "analysis_type": 2, "data_type": 2,
            "freq": structure.modes[number].frequency, "modal_m": scale**2, "modal_damp_vis": 0.01 * (number + 1),
            "modal_damp_his": 0.0, "r1": 0.0 * shape, "r2": 0.0 * shape, "r3": shape,
        }  # fmt: skip
        if "turn" in changes:
            omega, ratio = 2.0 * math.pi * one["freq"], 0.01 * (number + 1)
            damped = omega * math.sqrt(1.0 - ratio**2)
            root = complex(-ratio * omega, damped)
            a = 2j * damped * scale**2 * np.mean(changes["turn"]) ** 2
            one |= {"analysis_type": 3, "data_type": 5, "eig": root, "modal_a": a, "modal_b": -root * a}
        pyuff.UFF(str(path)).write_sets(one | changes.get("fields", {}), "add")
    return path


def of_file(path: Path, words: str, capsys: Capture) -> dict[str, Any]:
    return answered(capsys, "modes", "file", path, *words.split())


@pytest.mark.parametrize("changes", [{}, {"scale": 40.0}, {"turn": np.exp(0.7j)}, {"turn": np.exp(-2j), "scale": 0.1}])
def test_a_universal_file_gives_the_modes_written(changes: dict[str, Any], tmp_path: Path, capsys: Capture) -> None:
    numbers = of_file(written(tmp_path / "m.unv", **changes), "--container 20:z --modes 3", capsys)
    modes = cantilever.modes_of(THESIS, 6).modes
    for found, mode, ratio in zip(numbers["modes"], modes, (0.01, 0.02, 0.03), strict=False):
        assert found["frequency"] == pytest.approx(mode.frequency, rel=1e-5)
        assert found["mass"] == pytest.approx(mode.mass, rel=1e-4)
        assert found["damping_ratio"] == pytest.approx(ratio, rel=1e-4)
        assert found["base"] == pytest.approx(mode.base, abs=2e-3)
    assert numbers["next_mode"]["frequency"] == pytest.approx(modes[3].frequency, rel=1e-5)
    # 20 nodes lump a beam of 0.311 kg with 0.25 kg at its tip; half an element is at the clamp
    (note,) = numbers["notes"]
    assert float(note.split(": ")[1].split()[0]) == pytest.approx(0.56, rel=0.04)


def test_a_force_in_a_file_is_that_of_the_dimensions_and_its_units_are_heeded(tmp_path: Path, capsys: Capture) -> None:
    path, modes = written(tmp_path / "m.unv"), cantilever.modes_of(THESIS, 3, 0.3).modes
    forced = of_file(path, "--container 20:z --force-at 15:-z --modes 3", capsys)
    assert [one["force"] for one in forced["modes"]] == pytest.approx([-mode.force for mode in modes[:3]], rel=1e-4)
    assert forced["amplitude_factor"] == pytest.approx(-modes[0].force, rel=1e-4)
    assert forced["blocks"]["drive"] == "force"
    plain = of_file(path, "--container 20:z --modes 3", capsys)
    # in mm and N masses are tonnes: a file of the same numbers has masses a thousand times as large
    units = {"type": 164, "units_code": 9, "units_description": "mm N", "temp_mode": 1, "length": 1e3, "force": 1.0}
    pyuff.UFF(str(path)).write_sets(units | {"temp": 1.0, "temp_offset": 273.15}, "add")
    scaled = of_file(path, "--container 20:z --modes 3", capsys)
    for one, other in zip(scaled["modes"], plain["modes"], strict=True):
        assert one["mass"] == pytest.approx(1e3 * other["mass"])
        assert one["base"] == pytest.approx(other["base"], rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "words", "line"),
    [
        ({"fields": {"modal_m": 0.0}}, "20:z", "mode 1: 5.78347 Hz, .* 0 kg"),
        ({"fields": {"freq": 0.0}}, "20:z", "mode 1: 0 Hz, .* 1 kg"),
        ({"fields": {"freq": math.nan}}, "20:z", "mode 1: nan Hz"),
        ({"scale": 1e-90}, "20:z", "finite"),
        ({"turn": 1.0, "fields": {"eig": 1e308 + 1.7e308j}}, "20:z", "numbers"),
        ({"fields": {"modal_damp_vis": 0.0}}, "20:z", "damping .*5.783 Hz"),
        ({"turn": 1.0, "fields": {"modal_a": 3.0}}, "20:z", "mode 1: .*100 %.* 10 %"),
        ({"turn": np.exp(1j * np.linspace(0, 1, 20))}, "20:z", "mode .* 10 %"),
        ({"fields": {"analysis_type": 5, "freq_step_n": 1}}, "20:z", r"\b6 .*\b55, none"),
        ({}, "20:x", "container"),
        ({}, "21:z", r"node 21; .*\b20: 1, 2, 3, 4, 5, \.\.\."),
        ({}, "20:z --modes 7", r"--modes: .*\b7; .*\b6\b"),
        ({}, "20:z --force-at 3:x", "--force-at: .*5.783 Hz"),
        ({"count": 2, "fields": {"node_nums": np.zeros(20, int)}}, "1:z", "node 1"),
    ],
)
def test_what_a_scene_cannot_have_is_refused_in_one_line(
    changes: dict[str, Any], words: str, line: str, tmp_path: Path, capsys: Capture
) -> None:
    path = written(tmp_path / "m.unv", **changes)
    assert re.search(line, refusal(capsys, "modes", "file", path, "--container", *words.split()))


@pytest.mark.parametrize("content", [b"", b"text", bytes(range(256)) * 40, b"    -1\n    55\nx\n    -1\n"])
def test_what_is_no_universal_file_is_one_line(content: bytes, tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "m.unv").write_bytes(content)
    assert re.search(r"\b55\b", refusal(capsys, "modes", "file", tmp_path / "m.unv", "--container", "1:z"))
