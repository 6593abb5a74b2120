# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The files of a design: a scene to start from with its height map, all numbers, the picture, the page."""

import json
import math
from pathlib import Path

import numpy as np

from atpid_common import output
from atpid_common.files import Document
from atpid_common.vocabulary import DRIVES
from atpid_control.views.report.stages import per_cent
from atpid_design.make import Design
from atpid_design.page import page
from atpid_design.picture import panels
from atpid_design.problem import RTOL, Problem, mapping_of, time_constant
from atpid_sim.figure_style import save_panels
from atpid_sim.maps import HeightMap
from atpid_sim.maps.identity import identity_of
from atpid_sim.scene import Scene, load_scene, scene_from_mapping
from atpid_sim.scene.yaml12 import write_yaml

SCENE, MAP, NUMBERS, PAGE, PICTURE = "scene.yaml", "heights.npz", "design.json", "design.html", "design.png"
#: A stage lasts so many time constants of the closed damper, and at least so many periods.
_SETTLED, _PERIODS = 7.0, 40.0
#: Least samples a period of the laser; its noise [m], the stand's.
_SAMPLES, _NOISE = 40.0, 2e-5


def write(made: Design, folder: Path) -> list[Path]:
    """Write all files of a design; return their paths. Raises OutputError."""
    scene_file, map_file = folder / SCENE, folder / MAP
    with output.writing(scene_file):
        scene_file.write_text(scene_text(made), encoding="utf-8")
    height_map(made, scene_from_mapping(scene_mapping(made), SCENE, folder)).save(map_file)
    load_scene(scene_file)
    with output.writing(folder / NUMBERS):
        text = json.dumps(made.to_json(), indent=1, allow_nan=False) + "\n"
        (folder / NUMBERS).write_text(text, encoding="utf-8")
        (folder / PAGE).write_text(page(made), encoding="utf-8")
    save_panels(panels(made), folder / PICTURE)
    return [folder / name for name in (PAGE, NUMBERS, PICTURE, SCENE, MAP)]


def height_map(made: Design, scene: Scene) -> HeightMap:
    """Return the design heights as a map for the loop, which reaches beyond the amplitudes."""
    points = sorted([*made.points, *made.beyond], key=lambda one: one.amplitude)
    return HeightMap(
        amplitudes=np.array([one.amplitude for one in points]),
        mass_fractions=np.array([made.mass_fraction]),
        heights=np.array([[one.height for one in points]]),
        beam_amplitudes=np.array([[one.beam_amplitude.expected for one in points]]),
        efficiencies=np.array([[one.efficiency.expected for one in points]]),
        reproducible=np.array([[one.regular for one in points]]),
        identity=identity_of(scene),
        tolerance=RTOL,
    )


def scene_text(made: Design) -> str:
    """Return the scene to start from, with what it is and how to use it."""
    low, high = made.problem.amplitudes
    middle = made.points[len(made.points) // 2]
    unit = DRIVES[made.problem.drive].unit
    return (
        f"# Made by `atpid design`: the {made.problem.drive} goes to the least amplitude, the largest and\n"
        f"# {middle.amplitude:.3g} {unit}. The ceiling follows {MAP}, the heights of the design.\n"
        f"#   atpid bench {SCENE} --out run\n"
        f"#   atpid simulate {SCENE} --height {middle.height:.5g}\n"
        f"# Promised from {low:g} to {high:g} {unit}: {per_cent(made.efficiency)} less than with the damper closed,\n"
        f"# {per_cent(made.reduction)} less than without the damper.\n"
        f"{write_yaml(scene_mapping(made))}"
    )


def scene_mapping(made: Design) -> Document:
    """Return the blocks of the scene to start from."""
    problem, diameter = made.problem, 2.0 * made.radius
    low, high = problem.amplitudes
    middle = _digits(made.points[len(made.points) // 2].amplitude, 3)
    stages = _stages(problem, made, (low, high, middle))
    duration = stages[-1][0]
    rate = 1e3 * math.ceil(_SAMPLES * made.frequencies[1] / 1e3)
    mapping = mapping_of(problem, made.mass_fraction, [list(point) for point in stages])
    if problem.excitation_frequency is not None:
        first, last = problem.excitation_frequency
        mapping["excitation"]["frequency"] = first if first == last else [[0.0, first], [duration, last]]
    return mapping | {
        "container": {"side_friction": problem.side_friction, "slope": problem.slope},
        "ceiling": {
            "closed": diameter,
            "range": [diameter, _above(1.02 * max(one.height for one in (*made.points, *made.beyond)), 3)],
            "speed": max(_above(made.motor.speed, 2), 1e-3),
            "controller": "lookup",
            "map": MAP,
        },
        "duration": duration,
        "steady_window": [round(duration - 20.0 / made.resonance, 3), duration],
        "sensors": {"laser": {"rate": rate, "noise": _NOISE}},
        "seed": 1,
    }


def _stages(problem: Problem, made: Design, amplitudes: tuple[float, ...]) -> list[tuple[float, float]]:
    """Return ((t [s], A [m]), ...): each amplitude until the beam has settled, the next after a time constant."""
    tau = time_constant(problem, made.mass_fraction)
    hold = max(_SETTLED * tau, _PERIODS / made.resonance) + 2.0
    points: list[tuple[float, float]] = []
    end = 0.0
    for amplitude in amplitudes:
        begin = max(round(end + tau, 1), round(end + 0.1, 1)) if points else 0.0
        end = round(begin + hold, 1)
        points += [(begin, amplitude), (end, amplitude)]
    return points


def _digits(value: float, count: int) -> float:
    return float(f"{value:.{count - 1}e}")


def _above(value: float, digits: int) -> float:
    """Return a value rounded up to some digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return _digits(math.ceil(value / step - 1e-9) * step, digits)
