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
from sim_refusals import refused

from atpid_sim.maps import HeightMap, MapError
from atpid_sim.scene import SceneError, load_scene, standard_bench

ROOT = Path(__file__).parents[2]
#: Aliases of aliases: 4 x 20^6 values in 400 bytes.
BILLION = "a: &a [x, x, x, x]\n" + "\n".join(f"{b}: &{b} [{', '.join(['*' + a] * 20)}]" for a, b in pairwise("abcdefg"))
STANDARD = (ROOT / "scenes/standard.yaml").read_text()
MAP = ROOT / "atpid_control/config/maps/standard.npz"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("? [1, 2]\n: 3", "key"),
        ("a: !!timestamp 2001-02-31", "timestamp"),
        ("a: !!bool maybe", "YAML"),
        ("a: !!python/object/apply:os.getcwd []", "python"),
        ("a: !!binary aGVsbG8=", "binary"),
        ("a: &a [*a]", "alias"),
        (BILLION, "1000000"),
        ("[" * 100_000, "50"),
        ("{a: " * 100_000, "50"),
        ("a: \x00", "YAML"),
        ("{a: 1, a: 2}", "'a'"),
        ("", "mapping"),
    ],
)
def test_a_document_that_is_no_scene_is_one_line(text: str, part: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with refused(SceneError, "scene.yaml", part):
        load_scene(path)


@pytest.mark.parametrize("key", ["excitation.amplitude", "ceiling.profile"])
def test_points_without_end_are_refused(key: str) -> None:
    points = [[float(k), 0.02] for k in range(100_001)]
    block, _, inner = key.partition(".")
    given = {inner: points} | ({"frequency": 5.0} if block == "excitation" else {})
    with refused(SceneError, key, "100001", "100000"):
        standard_bench(**{block: given})


Change = Callable[[dict[str, Any]], dict[str, Any]]
BEYOND = {"beam_amplitudes": 1e6, "mass_fractions": 100.0, "efficiencies": 1e3}


def stored() -> dict[str, Any]:
    with np.load(MAP) as arrays:
        return {name: arrays[name] for name in arrays.files}


def about(**changes: Any) -> Change:
    def changed(arrays: dict[str, Any]) -> dict[str, Any]:
        text = json.loads(str(arrays["about"])) | changes
        return arrays | {"about": np.array(json.dumps(text))}

    return changed


def scaled(name: str, factor: float) -> Change:
    return lambda arrays: arrays | {name: arrays[name] * factor}


def typed(name: str, kind: str) -> Change:
    return lambda arrays: arrays | {name: arrays[name].astype(kind)}


@pytest.mark.parametrize(
    "change",
    [
        *(scaled("heights", factor) for factor in (1e6, 1e3, 1e-3, -1.0)),
        *(scaled(name, factor) for name, factor in BEYOND.items()),
        *(typed("heights", kind) for kind in ("U20", "datetime64[s]", "complex128")),
        *(typed("reproducible", kind) for kind in ("U5", "float64")),
        lambda arrays: arrays | {"heights": np.float64(0.3)},
        lambda arrays: arrays | {"amplitudes": arrays["amplitudes"][::-1]},
        lambda arrays: arrays | {"about": np.array("{")},
        lambda arrays: arrays | {"about": np.array("[" * 100_000)},
        lambda arrays: {name: value for name, value in arrays.items() if name != "reproducible"},
        *(about(format=number) for number in (0, 2)),
        *(about(system=given) for given in (None, {}, {"grain.radius": "wide"}, {"grain.radius": 1e300})),
        *(about(tolerance=given) for given in ("fine", None, -1.0)),
        *(about(failures=given) for given in (3, [[1]], [["a", "b", "c"]], [[0.1, 0.01, "x"]])),
    ],
)
def test_a_map_that_cannot_be_right_is_one_line(change: Change, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    np.savez(path, **change(stored()))
    with refused(MapError, "map.npz"):
        HeightMap.load(path)
