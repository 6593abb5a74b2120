# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile scenes and maps: one line each, in bounded time."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.errors import InputError
from atpid_sim.maps import HeightMap, MapError
from atpid_sim.scene import SceneError, load_scene, scene_from_mapping, standard_bench
from atpid_sim.scene.yaml12 import read_yaml

ROOT = Path(__file__).parents[2]
#: Aliases of aliases: 4 x 20^6 values in 400 bytes.
BILLION = "a: &a [x, x, x, x]\n" + "\n".join(f"{b}: &{b} [{', '.join(['*' + a] * 20)}]" for a, b in pairwise("abcdefg"))
STANDARD = (ROOT / "scenes/standard.yaml").read_text()
MAP = ROOT / "atpid_control/config/maps/standard.npz"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("? [1, 2]\n: 3", "a key is no word"),
        ("a: !!timestamp 2001-02-31", "tag tag:yaml.org,2002:timestamp is not read"),
        ("a: !!bool maybe", "not readable as YAML"),
        ("a: !!float ''", "not readable as YAML"),
        ("a: !!int 1.5", "not readable as YAML"),
        ("a: !!python/object/apply:os.getcwd []", "is not read"),
        ("a: !!binary aGVsbG8=", "is not read"),
        ("a: &a [*a]", "an alias contains itself"),
        (BILLION, "more than 1000000 values"),
        ("[" * 100_000, "more than 50 levels"),
        ("- " * 100_000, "more than 50 levels"),
        ("{a: " * 100_000, "more than 50 levels"),
        ("a: \x00", "not readable as YAML"),
        ("{a: 1, a: 2}", "key 'a' appears twice"),
        ("a: 0x", "a: unknown key; allowed: beam,"),
        ("- 1", "allowed: a mapping"),
        ("", "allowed: a mapping"),
    ],
)  # fmt: skip
def test_a_document_that_is_no_scene_is_one_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["excitation.amplitude", "ceiling.profile"])
def test_points_without_end_are_refused(key: str) -> None:
    points = [[float(k), 0.02] for k in range(100_001)]
    block, _, inner = key.partition(".")
    given = {inner: points} | ({"frequency": 5.0} if block == "excitation" else {})
    with pytest.raises(SceneError, match=rf"{key}: given 100001 points; allowed: at most 100000"):
        standard_bench(**{block: given})


@given(place=st.integers(0, len(STANDARD) - 1), text=st.text(max_size=6), cut=st.integers(0, 8))
def test_a_changed_scene_is_a_scene_or_one_line(place: int, text: str, cut: int) -> None:
    problem = ""
    try:
        scene_from_mapping(read_yaml(STANDARD[:place] + text + STANDARD[place + cut :], "a.yaml"), "a.yaml")
    except SceneError as error:
        problem = str(error)
    assert "\n" not in problem


def stored() -> dict[str, Any]:
    with np.load(MAP) as arrays:
        return {name: arrays[name] for name in arrays.files}


def about(**changes: Any) -> Callable[[dict[str, Any]], dict[str, Any]]:
    def changed(arrays: dict[str, Any]) -> dict[str, Any]:
        text = json.loads(str(arrays["about"])) | changes
        return arrays | {"about": np.array(json.dumps(text))}

    return changed


def scaled(name: str, factor: float) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda arrays: arrays | {name: arrays[name] * factor}


def typed(name: str, kind: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda arrays: arrays | {name: arrays[name].astype(kind)}


@pytest.mark.parametrize(
    "change",
    [
        scaled("heights", 1e6), scaled("heights", 1e3), scaled("heights", 1e-3), scaled("heights", -1.0),
        scaled("beam_amplitudes", 1e6), scaled("amplitudes", 1e6), scaled("amplitudes", -1.0),
        scaled("mass_fractions", 100.0), scaled("efficiencies", 1e3),
        typed("heights", "U20"), typed("heights", "datetime64[s]"), typed("heights", "complex128"),
        typed("amplitudes", "U20"), typed("reproducible", "U5"), typed("reproducible", "float64"),
        lambda arrays: arrays | {"heights": np.float64(0.3)},
        lambda arrays: arrays | {"heights": arrays["heights"][0]},
        lambda arrays: arrays | {"amplitudes": arrays["amplitudes"][::-1]},
        lambda arrays: arrays | {"about": np.array("{")},
        lambda arrays: arrays | {"about": np.array("[" * 100_000)},
        lambda arrays: arrays | {"about": np.array("null")},
        lambda arrays: {name: value for name, value in arrays.items() if name != "reproducible"},
        about(format=2), about(system=None), about(system={}), about(system={"grain.radius": "wide"}),
        about(system={"grain.radius": 1e300}), about(tolerance="fine"), about(tolerance=None), about(tolerance=-1.0),
        about(failures=3), about(failures=[[1]]), about(failures=[["a", "b", "c"]]), about(failures=[[0.1, 0.01, "x"]]),
    ],
)  # fmt: skip
def test_a_map_that_cannot_be_right_is_one_line(
    change: Callable[[dict[str, Any]], dict[str, Any]], tmp_path: Path
) -> None:
    path = tmp_path / "map.npz"
    np.savez(path, **change(stored()))
    with pytest.raises(MapError) as caught:
        HeightMap.load(path)
    assert "\n" not in str(caught.value)


GOOD = MAP.read_bytes()


@given(places=st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_changed_map_is_a_map_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, places: list[tuple[int, int]]
) -> None:
    changed = bytearray(GOOD)
    for place, value in places:
        changed[place] = value
    path = tmp_path_factory.getbasetemp() / "changed_map.npz"
    path.write_bytes(changed)
    known, problem = np.zeros(0), ""
    try:
        heights = HeightMap.load(path).heights
        known = heights[np.isfinite(heights)]
    except InputError as error:
        problem = str(error)
    assert "\n" not in problem
    assert ((known > 0.0) & (known <= 100.0)).all()


def test_the_shipped_map_is_read() -> None:
    assert HeightMap.load(MAP).heights.shape[1] > 100
