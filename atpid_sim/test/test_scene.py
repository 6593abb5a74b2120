# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes: what loads, what is refused, the last numbers that are taken, and what is named as unusual."""

import copy
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sim_refusals import has_parts, refused

from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.simulate import simulate
from atpid_sim.system import reduced_mass

SCENES = Path(__file__).parents[2] / "scenes"
BENCH = load_scene(SCENES / "standard.yaml")
STANDARD = BENCH.to_mapping()
CONTROLLED = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}
ELASTIC = {"young_modulus": 2.1e8, "poisson_ratio": 0.2}
HERTZ = {"law": "hertz", **ELASTIC}
WALTON = {"law": "walton_braun", "stiffness": 1e5}
SCALARS: dict[str, Any] = {
    **{"2.1e8": 2.1e8, "1e-6": 1e-6, "1E+3": 1e3, ".5": 0.5, "5.": 5.0, "-3": -3, "0x10": 16, "0o17": 15, "017": 17},
    **{"1:30": "1:30", "yes": "yes", "on": "on", "1_000": "1_000", "true": True, "~": None, "": None},
    **{".inf": math.inf, "2020-01-01": "2020-01-01"},
}


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


@pytest.mark.parametrize(("text", "value"), SCALARS.items())
def test_scalars_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    found = read_yaml(f"key: {text}", "here")["key"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("path", "value", "parts"),
    [
        ("beam.mas", 1.0, "beam.mas mass mass stiffness damping"),
        ("beam.mass", "0,3258", "beam.mass '0,3258' 0.3258"),
        ("excitation.frequency", "5.47 Hz", "excitation.frequency '5.47 Hz' number"),
        ("grain.mass_fraction", 10, "grain.mass_fraction 10.0 1e-06 0.999999 10 %"),
        ("beam.frequency", 5.7, "beam stiffness frequency stiffness frequency"),
        ("beam", {"mass": 0.3, "frequency": 5.7}, "beam.damping missing"),
        ("beam", {"mass": 0.3, "stiffness": 9.0, "damping_ratio": -1}, "beam.damping_ratio -1 0"),
        ("beam.mass", True, "beam.mass True number"),
        ("beam.mass", math.nan, "beam.mass nan finite"),
        ("beam.mass", ..., "beam.mass missing kg"),
        ("beam.stiffness", math.inf, "beam.stiffness inf finite"),
        ("beam.damping", 1e8, "beam.damping 100000000.0 20000 472"),
        ("contact.law", "tsui", "contact.law 'tsui' tsuji impact, linear"),
        ("contact.poisson_ratio", 0.6, "contact.poisson_ratio 0.6 -0.999 0.5"),
        ("contact", HERTZ | {"law": "lee_herrmann", "damping": 1e300}, "contact.damping 1e+300 0"),
        ("contact", WALTON | {"unloading_stiffness": 9e4}, "contact.unloading_stiffness 90000.0 stiffness 100000"),
        ("contact", WALTON | {"restitution": 1e-200}, "contact.restitution 1e-200 0.0001 1"),
        ("excitation", {"amplitud": 1.0}, "excitation amplitud {amplitude, frequency}"),
        ("excitation.frequency", "resonanc", "excitation.frequency 'resonanc' number 'resonance'"),
        ("excitation.amplitude", [[0, 1], [0, 2]], "excitation.amplitude 0.0 rising"),
        ("excitation.amplitude", [], "excitation.amplitude []"),
        ("excitation.amplitude", [[0.0, 0.0], [1e-9, 1.0]], "excitation.amplitude 0 m 1 m 1e-09 s 1e+06 m/s"),
        ("excitation", {"free": {"deflection": 1e300}}, "excitation.free.deflection 1e+300 -1000 1000"),
        ("excitation", {"series": {"file": "no.csv"}}, "excitation.series.file 'no.csv' existing"),
        ("ceiling", {"height": 0.016}, "ceiling.height 0.016 2 r 0.017 m"),
        ("ceiling", {"profile": [[0, 0.1], [1, 0.01]]}, "ceiling.profile 0.01 diam"),
        ("ceiling.start", 8.0, "ceiling.end 7.0 start 8 s"),
        ("ceiling.end", 6.0 + 1e-10, "ceiling.end 0.017 m 0.2 m 1e-10 s 1e+06"),
        ("ceiling", CONTROLLED | {"controller": "lokup"}, "ceiling.controller 'lokup' 'lookup' 'pca' 'direct' lookup"),
        ("ceiling", CONTROLLED | {"range": [0.001, 1.0]}, "ceiling.range 0.001 diameter"),
        ("ceiling", CONTROLLED | {"closed": 2.0}, "ceiling.closed 2.0 [0.017, 1]"),
        ("steady_window", [14.0, 17.0], "steady_window [14.0, 17.0] 0"),
        ("steady_window", [15.0, 15.0], "steady_window [15.0, 15.0] rising"),
        ("sensors", {"laser": {"rate": 1001.0}}, "recording.block 0.05 samples"),
        ("sensors", {"laser": {"saturation": [1, 0]}}, "sensors.laser.saturation [1.0, 0.0] rising"),
        ("seed", 1.5, "seed 1.5 integer"),
        ("tolerance", 0.0, "tolerance 0.0 1e-13 0.5"),
        ("gravity", ..., "gravity missing m/s^2"),
    ],
)
def test_what_cannot_be_is_refused_in_one_useful_line(path: str, value: Any, parts: str) -> None:
    with refused(SceneError, "bench.yaml", *parts.split()):
        scene_from_mapping(changed(path, value), source="bench.yaml")


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"", "None beam, further_modes"),
        (b"beam: 1\nbeam: 2\n", "bad.yaml:2: YAML 'beam' twice"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "bad.yaml text"),
    ],
)
def test_a_file_that_is_no_scene(tmp_path: Path, content: bytes, parts: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    with refused(SceneError, *parts.split()):
        load_scene(file)
    with refused(SceneError, "nothing.yaml"):
        load_scene(tmp_path / "nothing.yaml")
    with refused(SceneError, str(tmp_path), "folder"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("contact.young_modulus", (2.1e12, 2.1e4)),
        ("excitation.frequency", (0.01, 1000.0)),
        ("gravity", (0.0, 100.0)),
        ("ceiling", ({"height": 0.017}, {"closed": 0.017, "open": 1.0, "start": 1.0, "end": 1.0983}, CONTROLLED)),
    ],
)
def test_extremes_are_allowed(path: str, values: tuple[Any, ...]) -> None:
    for value in values:
        scene_from_mapping(changed(path, value))


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


def test_copies_are_checked_and_leave_the_original_alone() -> None:
    copied = BENCH.with_(height=0.3, amplitude=0.02, mass_fraction=0.2, frequency=5.0, tolerance=1e-4)
    assert copied.ceiling.heights == ((0.0, 0.3),)
    assert copied.to_mapping()["excitation"] == {"amplitude": 0.02, "frequency": 5.0}
    assert (copied.grain.mass_fraction, copied.tolerance) == (0.2, 1e-4)
    assert load_scene(SCENES / "standard.yaml") == BENCH


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"height": 0.01}, "ceiling.height 0.01"),
        ({"height": "0.2"}, "ceiling.height '0.2' number"),
        ({"tolerence": 1e-4}, "tolerence tolerance"),
        ({"mass": 0.4}, "mass beam.mass"),
        ({"stifness": 400.0}, "stifness beam.stiffness"),
    ],
)
def test_a_wrong_change_of_a_scene_is_one_line_with_a_hint(change: dict[str, Any], parts: str) -> None:
    with refused(SceneError, "changed", *parts.split()):
        BENCH.with_(**change)


def test_a_part_of_beam_or_grain_keeps_the_rest() -> None:
    assert BENCH.with_(beam={"mass": 0.4}).beam.stiffness == BENCH.beam.stiffness
    faster = BENCH.with_(beam={"frequency": 7.0, "damping_ratio": 0.01}).beam
    assert faster.stiffness == pytest.approx((14.0 * math.pi) ** 2 * BENCH.beam.mass)
    assert faster.damping == pytest.approx(0.02 * math.sqrt(faster.stiffness * faster.mass))
    assert BENCH.with_(grain={"radius": 0.005}).grain.mass_fraction == BENCH.grain.mass_fraction
    assert BENCH.with_(height=np.float64(0.25), mass_fraction=np.float64(0.2)).ceiling.heights == ((0.0, 0.25),)


def test_defaults_are_visible() -> None:
    scene = scene_from_mapping(changed("steady_window", ...))
    assert scene.steady_window == (14.0, 16.0)
    keys = {line.split(" = ")[0] for line in scene.defaults()}
    assert {"steady_window", "drive", "container.slope", "sensors.laser.rate", "seed"} <= keys


def test_every_wrong_key_is_named() -> None:
    wrong = {"beam": {"mass": "a", "stiffness": "b", "damping": 0.56}, "gravity": "c", "duration": -1.0, "seed": -1}
    with refused(SceneError, "beam.mass", "'a'", "beam.stiffness", "gravity", "duration", "seed"):
        scene_from_mapping({**STANDARD, **wrong})


@pytest.mark.parametrize("restitution", [1.0, 0.9, 1e-3, 4e-6, 1e-6, 1e-9, 1e-12])
def test_a_linear_contact_has_the_restitution_asked_for(restitution: float) -> None:
    scene = short(contact={"law": "linear", "stiffness": 1e5, "restitution": restitution})
    found = restitution_of(contact_of(scene), 1.0, reduced_mass(system_of(scene)))
    assert found == pytest.approx(restitution, rel=1e-9)
    assert simulate(scene, "soft", check=False).amplitude > 0.0
    steep = short(contact={"law": "walton_braun", "stiffness": 1e5, "restitution": max(restitution, 1e-4)})
    assert simulate(steep, "soft", check=False).energy_residual == pytest.approx(0.0, abs=1e-5)


def short(**blocks: Any) -> Scene:
    """The standard scene for 2 s under a fixed ceiling."""
    given: dict[str, Any] = {"duration": 2.0, "steady_window": [1.0, 2.0], "ceiling": {"height": 0.2}}
    return BENCH.with_(**(given | blocks))


def test_no_damping_ratio_for_what_is_no_restitution() -> None:
    for restitution in (1e-300, 0.0, -1.0, 2.0, math.nan):
        with refused(ValueError, "restitution", "1e-12", "1"):
            damping_ratio_for(restitution)


@pytest.mark.parametrize("fidelity", ["soft", "finite", "impact"])
@pytest.mark.parametrize(
    "blocks",
    [
        {"beam": {"damping": 23600.0}},
        {"beam": {"stiffness": 1e-6, "damping": 0.0}},
        {"beam": {"mass": 1e-6, "damping": 0.0}, "duration": 0.01, "steady_window": [0.0, 0.01]},
        {"gravity": 1e4},
        {"grain": {"mass_fraction": 1e-6}},
        {"grain": {"mass_fraction": 0.999999}},
        {"grain": {"radius": 1e-6}},
        {"contact": {"law": "tsuji", **ELASTIC, "young_modulus": 1e18, "damping_ratio": 1e6}},
        {"contact": {"law": "linear", "stiffness": 1e-3, "damping": 1e9}},
    ],
    ids=str,
)
def test_the_last_numbers_allowed_end_by_name(blocks: dict[str, Any], fidelity: str) -> None:
    try:
        amplitude = simulate(short(**blocks), fidelity, check=False).amplitude
    except NumericalFailure as failure:
        if not re.search("deeper.*radius", str(failure)):
            raise
    else:
        assert math.isfinite(amplitude)


#: Fractions of grain for which the thesis kept the radius: denser than any metal.
DENSE = {"stepped_4_8_phi_0_2": "31660", "stepped_4_8_phi_0_3": "54280"}


@pytest.mark.parametrize("name", [path.stem for path in sorted(SCENES.glob("*.yaml"))])
def test_the_shipped_scenes_are_usual_but_for_the_heavy_grains(name: str) -> None:
    warnings = load_scene(SCENES / f"{name}.yaml").warnings()
    assert len(warnings) == (name in DENSE)
    for line in warnings:
        has_parts(line, ("grain", "density", DENSE[name]))


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"amplitude": 10.0}, "excitation, amplitude: 10 m 1e-06 0.2 m metres"),
        ({"ceiling": {"closed": 0.017, "open": 200.0, "start": 6.0, "end": 7.0}}, "ceiling, height: 200 m 3 m metres"),
        ({"mass_fraction": 0.24}, "grain, density: 39990 kg/m^3"),
        ({"grain": {"mass_fraction": 0.1, "radius": 0.0001}}, "grain.radius: 0.0001 m"),
        ({"beam": {"mass": 325.8, "stiffness": 427.6, "damping": 0.56}}, "beam, static deflection: 8.305 m"),
        ({"beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 28.0}}, "beam.damping, ratio: 1.125"),
        ({"steady_window": [15.9, 16.0]}, "steady_window, periods: 0.547 2"),
        ({"excitation": {"free": {"deflection": -20.0}}}, "excitation.free.deflection: 20 m"),
        # 0.3 x 9.80665 over omega^2 X = 262.7 m/s^2
        ({"container": {"side_friction": 0.3}, "gravity": 0.0}, "container.side_friction, acceleration: 0.0112"),
        # a beam of 0.4 m: 1.5 / 0.4 x 0.2224 m
        ({"container": {"slope": 3.75}}, "container.slope, amplitude: 0.834 rad 0.03 rad"),
    ],
)
def test_an_unusual_value_is_named(changes: dict[str, Any], parts: str) -> None:
    lines = BENCH.with_(**changes).warnings()
    has_parts(next(line for line in lines if line.startswith(parts.split()[0])), tuple(parts.split()))


def test_friction_counts_with_what_of_gravity_is_not_along_the_motion() -> None:
    rubs = {"side_friction": 0.3}
    assert BENCH.with_(container=rubs).warnings() == []
    assert len(BENCH.with_(container=rubs, gravity=5.0).warnings()) == 1
    # at three times the amplitude a third of the acceleration; at the least amplitude of a profile it is largest
    assert BENCH.with_(container=rubs, gravity=0.0, amplitude=0.03).warnings() == []
    assert len(BENCH.with_(container=rubs, gravity=0.0, amplitude=[[0.0, 0.01], [1.0, 0.03]]).warnings()) == 1
