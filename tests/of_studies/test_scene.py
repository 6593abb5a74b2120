# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes: what loads, what is refused and with which message."""

import copy
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from atpid_sim.scene import Scene, SceneError, load_scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from studies.figures.scenes import schema_tables

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml").to_mapping()


def changed(path: str, value: Any) -> dict[str, Any]:
    """The standard scene with one value changed, or (value ...) taken away."""
    mapping = copy.deepcopy(STANDARD)
    *blocks, key = path.split(".")
    block = mapping
    for name in blocks:
        block = block[name]
    if value is ...:
        del block[key]
    else:
        block[key] = value
    return mapping


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_scene_loads_and_comes_back_from_its_own_yaml(path: Path) -> None:
    scene = load_scene(path)
    again = scene_from_mapping(read_yaml(scene.to_yaml(), "again"))
    assert again == scene
    assert again.to_mapping() == scene.to_mapping()
    assert yaml.safe_load(scene.to_yaml()) == scene.to_mapping()  # YAML 1.1 readers see the same numbers


def test_the_standard_bench_is_the_thesis_s() -> None:
    scene = load_scene(SCENES / "standard.yaml")
    assert scene.beam.mass == pytest.approx(0.905 * 0.36, rel=1e-15)
    assert scene.grain_mass / scene.total_mass == pytest.approx(0.1, rel=1e-15)
    assert scene.frequency_hz == pytest.approx(math.sqrt(427.6 / 0.362) / (2 * math.pi), rel=1e-15)
    assert scene.frequency_hz == pytest.approx(5.47, abs=0.005)
    assert scene.static_deflection == pytest.approx(0.362 * 9.81 / 427.6, rel=1e-15)
    assert scene.ceiling.heights == ((6.0, 0.017), (7.0, 0.2))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2.1e8", 2.1e8), ("1e-6", 1e-6), ("1E+3", 1e3), (".5", 0.5), ("5.", 5.0), ("-3", -3), ("0x10", 16),
        ("0o17", 15), ("017", 17), ("1:30", "1:30"), ("yes", "yes"), ("on", "on"), ("1_000", "1_000"), ("true", True),
        ("~", None), ("", None), (".inf", math.inf), ("2020-01-01", "2020-01-01"),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    found = read_yaml(f"key: {text}", "here")["key"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("beam.mas", 1.0, "beam.mas: unknown key; did you mean mass?; allowed: mass, stiffness, damping"),
        ("beam.mass", "heavy", "beam.mass: given 'heavy'; allowed: a bare number, in kg"),
        ("beam.mass", "0,3258", "beam.mass: given '0,3258'; allowed: a number with a decimal point: 0.3258"),
        ("excitation.frequency", "5.47 Hz", "excitation.frequency: given '5.47 Hz'; allowed: a bare number, or the"),
        ("excitation.amplitude", "10 mm", "excitation.amplitude: given '10 mm'; allowed: a bare number, in m"),
        ("grain.mass_fraction", 10, "grain.mass_fraction: given 10.0; allowed: from 1e-06 to 0.999999 (a share: 10 %"),
        ("beam.frequency", 5.7, "beam: given stiffness and frequency; allowed: exactly one of stiffness, frequency"),
        ("beam", {"mass": 0.3, "frequency": "5.7 Hz", "damping": 0.5}, "beam.frequency: given '5.7 Hz'; allowed: from"),
        ("beam", {"mass": 0.3, "frequency": 5.7}, "beam.damping: missing; allowed: reduced damping [N s/m]; or give"),
        ("beam", {"mass": 0.3, "stiffness": 9.0, "damping_ratio": -1}, "beam.damping_ratio: given -1; allowed: from 0"),
        ("beam", {"mass": "x", "frequency": 5.7, "damping_ratio": 0.1}, "beam.mass: given 'x'; allowed: a bare number"),
        ("beam.mass", True, "beam.mass: given True; allowed: number"),
        ("beam.mass", math.nan, "beam.mass: given nan; allowed: a finite number"),
        ("beam.stiffness", math.inf, "beam.stiffness: given inf; allowed: a finite number"),
        ("beam.mass", -1.0, "beam.mass: given -1.0; allowed: from 1e-06 to 1e+06"),
        ("beam.mass", ..., "beam.mass: missing; allowed: reduced mass of beam and container, without the grain [kg]"),
        ("beam", 3, "beam: given 3; allowed: "),
        ("contact.law", "tsui", "contact.law: given 'tsui'; did you mean tsuji?; allowed: impact, linear, "),
        ("contact.law", ..., "contact.law: missing; allowed: impact, linear, "),
        ("contact", 3, "contact: given 3; allowed: a block with law"),
        ("contact.damping_rato", 1.0, "contact.damping_rato: unknown key; did you mean damping_ratio?"),
        ("contact.poisson_ratio", 0.6, "contact.poisson_ratio: given 0.6; allowed: from -0.999 to 0.5"),
        ("contact", {"law": "linear", "stiffness": 1e5}, "contact: given neither; allowed: exactly one of damping, "),
        (
            "contact",
            {"law": "walton_braun", "stiffness": 2e5, "unloading_stiffness": 1e5},
            "contact.unloading_stiffness: given 100000.0; allowed: at least stiffness (200000 N/m)",
        ),
        ("excitation", {"amplitud": 1.0}, "excitation: given keys amplitud; allowed: one of {amplitude, frequency}"),
        (
            "excitation.frequency",
            "resonanc",
            "excitation.frequency: given 'resonanc'; allowed: a bare number, or the word 'resonance'; did you mean",
        ),
        ("excitation.frequency", 0, "excitation.frequency: given 0.0; allowed: from 1e-06 to 1e+06"),
        ("excitation.amplitude", [[0, 1], [0, 2]], "excitation.amplitude: given 0.0; allowed: times in rising order"),
        ("excitation.amplitude", [[0, 1, 2]], "excitation.amplitude[0]: given [0, 1, 2]; allowed: a pair of numbers"),
        ("excitation.amplitude", [], "excitation.amplitude: given []; allowed: "),
        ("excitation.phase", 0.0, "excitation.phase: unknown key; allowed: amplitude, frequency"),
        (
            "excitation",
            {"free": {"deflectio": 1.0}},
            "excitation.free.deflectio: unknown key; did you mean deflection?",
        ),
        (
            "excitation",
            {"sweep": {"amplitude": 1.0, "from": 1, "too": 2}},
            "excitation.sweep.too: unknown key; did you me",
        ),
        (
            "excitation",
            {"series": {"file": "no.csv"}},
            "excitation.series.file: given 'no.csv'; allowed: an existing file",
        ),
        (
            "ceiling",
            {"height": 0.016},
            "ceiling.height: given 0.016; allowed: at least the grain's diameter 2 r = 0.017 m",
        ),
        (
            "ceiling",
            {"profile": [[0, 0.1], [1, 0.01]]},
            "ceiling.profile: given 0.01; allowed: at least the grain's diam",
        ),
        ("ceiling", {}, "ceiling: given {}; allowed: one of {height}"),
        ("ceiling.start", 8.0, "ceiling.end: given 7.0; allowed: later than start (8 s)"),
        (
            "steady_window",
            [14.0, 17.0],
            "steady_window: given [14.0, 17.0]; allowed: two rising times between 0 and dur",
        ),
        ("steady_window", [15.0, 15.0], "steady_window: given [15.0, 15.0]; allowed: two rising times"),
        ("steady_window", 14, "steady_window: given 14; allowed: a pair of numbers"),
        ("grain.mass_fraction", 1.0, "grain.mass_fraction: given 1.0; allowed: from 1e-06 to 0.999999"),
        ("grain.mass_fraction", 0, "grain.mass_fraction: given 0.0; allowed: from 1e-06 to 0.999999"),
        (
            "sensors",
            {"laser": {"rate": 1001.0}},
            "recording.block: given 0.05; allowed: a whole number of samples a block",
        ),
        (
            "sensors",
            {"laser": {"saturation": [1, 0]}},
            "sensors.laser.saturation: given [1.0, 0.0]; allowed: two rising",
        ),
        ("seed", 1.5, "seed: given 1.5; allowed: integer"),
        ("tolerance", 0.0, "tolerance: given 0.0; allowed: from 1e-13 to 0.5"),
        ("gravity", ..., "gravity: missing; allowed: gravity [m/s^2]"),
    ],
)
def test_what_cannot_be_is_refused_in_one_useful_line(path: str, value: Any, expected: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene_from_mapping(changed(path, value), source="bench.yaml")
    message = str(caught.value)
    assert message.startswith(f"bench.yaml: {expected}")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("ceiling", "expected"),
    [
        (
            {"controller": "lokup"},
            "ceiling.controller: given 'lokup'; allowed: 'lookup', 'pca', 'direct', 'search' or 'learned'; did",
        ),
        ({"range": [1.0, 0.1]}, "ceiling.range: given [1.0, 0.1]; allowed: two rising heights"),
        ({"range": [0.001, 1.0]}, "ceiling.range: given 0.001; allowed: at least the grain's diameter"),
        ({"closed": 2.0}, "ceiling.closed: given 2.0; allowed: a height within the range [0.017, 1]"),
        ({"speed": 0.0}, "ceiling.speed: given 0.0; allowed: from 1e-09 to "),
    ],
)
def test_a_controlled_ceiling_is_checked(ceiling: dict[str, Any], expected: str) -> None:
    good = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
    scene_from_mapping(changed("ceiling", good))
    with pytest.raises(SceneError, match="^scene: " + expected.replace("[", r"\[")):
        scene_from_mapping(changed("ceiling", good | ceiling))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "given None; allowed: a mapping with the keys beam, further_modes, drive, grain, "),
        (b"- 1\n", r"given \[1\]; allowed: a mapping"),
        (b"beam: {mass: 1\n", "bad.yaml:2: not readable as YAML: "),
        (b"beam: 1\nbeam: 2\n", "bad.yaml:2: not readable as YAML: key 'beam' appears twice"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "is not text"),
        (b"a: \x01\n", "not readable as YAML"),
        (b"a: !!python/object:os.system {}\n", "not readable as YAML"),
    ],
)
def test_a_file_that_is_no_scene(tmp_path: Path, content: bytes, expected: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    with pytest.raises(SceneError, match=expected) as caught:
        load_scene(file)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"nothing\.yaml: no such file"):
        load_scene(tmp_path / "nothing.yaml")
    with pytest.raises(SceneError, match="is a folder; give the path of a file"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("contact.young_modulus", 2.1e12), ("contact.young_modulus", 2.1e4), ("contact.damping_ratio", 0.0),
        ("contact.damping_ratio", 5.0), ("grain.mass_fraction", 0.001), ("grain.mass_fraction", 0.9),
        ("excitation.amplitude", 1e-6), ("excitation.amplitude", 1.0), ("excitation.frequency", 0.01),
        ("excitation.frequency", 1000.0), ("gravity", 0.0), ("gravity", 100.0), ("ceiling", {"height": 0.017}),
        ("ceiling", {"closed": 0.017, "open": 1.0, "start": 1.0, "end": 1.0983}),
    ],
)  # fmt: skip
def test_extremes_are_allowed(path: str, value: Any) -> None:
    scene_from_mapping(changed(path, value))


@given(st.floats(min_value=1e-5, max_value=1e3))
def test_a_height_of_exactly_the_diameter_is_allowed(radius: float) -> None:
    mapping = changed("grain.radius", radius)
    mapping["ceiling"] = {"height": 2.0 * radius}
    assert scene_from_mapping(mapping).ceiling.heights == ((0.0, 2.0 * radius),)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@pytest.mark.slow
@given(ANYTHING, st.sampled_from([*STANDARD, "sensors", "recording", "seed"]))
@example({"two\nlines": None}, "beam")
def test_whatever_stands_in_a_block_gives_a_scene_or_one_line(value: Any, key: str) -> None:
    try:
        found: Scene | str = scene_from_mapping(changed(key, value))
    except SceneError as error:
        found = str(error)
    assert isinstance(found, Scene) or "\n" not in found


def test_copies_are_checked_and_leave_the_original_alone() -> None:
    scene = load_scene(SCENES / "standard.yaml")
    copied = scene.with_(height=0.3, amplitude=0.02, mass_fraction=0.2, frequency=5.0, tolerance=1e-4)
    assert copied.ceiling.heights == ((0.0, 0.3),)
    assert copied.to_mapping()["excitation"] == {"amplitude": 0.02, "frequency": 5.0}
    assert (copied.grain.mass_fraction, copied.tolerance) == (0.2, 1e-4)
    assert scene == load_scene(SCENES / "standard.yaml")
    with pytest.raises(SceneError, match=r"changed scene: ceiling\.height: given 0\.01"):
        scene.with_(height=0.01)
    with pytest.raises(SceneError, match="changed scene: tolerence: unknown key; did you mean tolerance"):
        scene.with_(tolerence=1e-4)


def test_defaults_are_visible() -> None:
    scene = scene_from_mapping(changed("steady_window", ...))
    assert scene.steady_window == (14.0, 16.0)
    keys = [line.split(" = ")[0] for line in scene.defaults()]
    assert keys == [
        "further_modes", "drive", "further_dampers", "container.side_friction", "container.slope",
        "contact.wall_young_modulus", "contact.wall_poisson_ratio", "contact.wall_stiffness",
        "contact.wall_speed", "initial", "steady_window", "sensors.laser.noise",
        "sensors.laser.saturation", "sensors.laser.rate", "sensors.load_cell", "sensors.accelerometer",
        "recording.block", "recording.chunk", "seed", "faults",
    ]  # fmt: skip
    assert "steady_window = [14.0, 16.0]" in "\n".join(scene.defaults())
    full = load_scene(SCENES / "thesis_4_3.yaml")
    assert "seed" not in [line.split(" = ")[0] for line in full.defaults()]


def test_paths_start_from_the_scene_s_folder(tmp_path: Path) -> None:
    (tmp_path / "support.csv").write_text("time,support_displacement\n0,0\n")
    mapping = changed("excitation", {"series": {"file": "support.csv"}})
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup", "map": "maps/a.npz"}
    mapping["ceiling"] = ceiling
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(mapping))
    scene = load_scene(tmp_path / "scene.yaml")
    assert scene.to_mapping()["excitation"]["series"]["file"] == str(tmp_path / "support.csv")
    assert scene.to_mapping()["ceiling"]["map"] == str(tmp_path / "maps" / "a.npz")
    assert scene_from_mapping(scene.to_mapping()) == scene


def test_a_beam_may_be_given_by_frequency_and_damping_ratio() -> None:
    """Of the beam without the grain; the scene holds stiffness and damping however they were given."""
    ratio = 0.56 / (2.0 * math.sqrt(427.6 * 0.3258))
    frequency = math.sqrt(427.6 / 0.3258) / (2.0 * math.pi)
    for beam in (
        {"mass": 0.3258, "frequency": frequency, "damping_ratio": ratio},
        {"mass": 0.3258, "frequency": frequency, "damping": 0.56},
        {"mass": 0.3258, "stiffness": 427.6, "damping_ratio": ratio},
    ):
        scene = scene_from_mapping({**STANDARD, "beam": beam})
        assert scene.beam.stiffness == pytest.approx(427.6, rel=1e-14)
        assert scene.beam.damping == pytest.approx(0.56, rel=1e-14)
        assert scene_from_mapping(scene.to_mapping()) == scene
        assert [line for line in scene.defaults() if line.startswith("beam")] == []


def test_every_wrong_key_is_named() -> None:
    beam = {"mass": "a", "stiffness": "b", "damping": 0.56}
    with pytest.raises(SceneError) as caught:
        scene_from_mapping({**STANDARD, "beam": beam, "gravity": "c", "duration": -1.0, "seed": -1})
    message = str(caught.value)
    assert "beam.mass: given 'a'" in message
    assert "also wrong: beam.stiffness, gravity, duration, seed)" in message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{mass: 0,3258, stiffness: 427.6}", "beam.mass: given 0 and, after a comma, 3258; allowed: a number with a"),
        ("{mass: 0.3258, stiffness: 427,6}", "beam.stiffness: given 427 and, after a comma, 6; allowed: a number with"),
    ],
)
def test_a_decimal_comma_in_braces_is_named(text: str, expected: str) -> None:
    with pytest.raises(SceneError, match=expected):
        scene_from_mapping(read_yaml(f"beam: {text}", "here"))


def test_the_documented_keys_are_those_that_are_checked() -> None:
    text = (SCENES.parent / "docs" / "scenes.md").read_text(encoding="utf-8")
    assert schema_tables() in text
    assert [path.name for path in SCENES.glob("*.yaml") if f"`{path.name}`" not in text] == []
    example = text.split("```yaml\n")[1].split("```")[0]
    assert scene_from_mapping(read_yaml(example, "docs")) == load_scene(SCENES / "standard.yaml")
