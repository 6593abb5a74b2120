# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The points of a study's sweep, and the scene of each."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.system import reduced_mass
from studies.thesis.study import Study, StudyError, Value

Point = dict[str, Value]

#: Keys of a sweep that are not keys of a scene: a measure takes them itself.
FREE_KEYS = ("case",)


class Job(NamedTuple):
    """One point of a sweep with its scene."""

    number: int
    point: Point
    scene: Scene


def jobs(study: Study, scenes: Path) -> list[Job]:
    """Return the points of a study; `scenes` is the folder of its scene files. Raises StudyError, SceneError."""
    points = [dict(zip(grid, values, strict=True)) for grid in study.sweep
              for values in itertools.product(*grid.values())]  # fmt: skip
    return [
        Job(number, point, _scene(study.scene, point, scenes, study.instantaneous))
        for number, point in enumerate(points)
    ]


def matches(point: Mapping[str, Value], at: Mapping[str, Value | list[Value]]) -> bool:
    """Return whether a point has the values `at` names, or one of those listed."""
    wanted = {key: value if isinstance(value, list) else [value] for key, value in at.items()}
    return all(key in point and point[key] in values for key, values in wanted.items())


def _scene(changes: Mapping[str, Any], point: Point, scenes: Path, instantaneous: bool) -> Scene:
    if "scene_file" in point:
        return load_scene(scenes / str(point["scene_file"]))
    scene = standard_bench(**changes)
    for key in ("mass_fraction", "radius", "gravity", "amplitude", "deflection", "frequency_ratio", "height"):
        if key in point:
            scene = _changed(scene, key, float(point[key]))
    if instantaneous:
        restitution = restitution_of(contact_of(scene), 1.0, reduced_mass(system_of(scene)))
        scene = scene.with_(contact={"law": "impact", "restitution": restitution})
    unknown = set(point) - {*FREE_KEYS, "mass_fraction", "radius", "gravity", "amplitude", "deflection",
                            "frequency_ratio", "height", "scene_file"}  # fmt: skip
    if unknown:
        raise StudyError(f"sweep: given {', '.join(sorted(unknown))}; that is no key of a sweep")
    return scene


def _changed(scene: Scene, key: str, value: float) -> Scene:
    if key in ("mass_fraction", "amplitude"):
        return scene.with_(**{key: value})
    if key == "frequency_ratio":
        return scene.with_(frequency=value * scene.natural_frequency_hz)
    if key == "deflection":
        return scene.with_(excitation={"free": {"deflection": value}})
    if key == "gravity":
        return scene.with_(gravity=value)
    mapping = scene.to_mapping()
    if key == "radius":  # the closed damper holds the grain
        ceiling = mapping["ceiling"] | ({"closed": 2.0 * value} if "closed" in mapping["ceiling"] else {})
        return scene.with_(grain=mapping["grain"] | {"radius": value}, ceiling=ceiling)
    if "open" in mapping["ceiling"] and value > mapping["ceiling"]["closed"]:
        return scene.with_(ceiling=mapping["ceiling"] | {"open": value})
    return scene.with_(height=value)
