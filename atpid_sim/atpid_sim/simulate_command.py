# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim simulate`: one scene, its result as a table or as JSON."""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

from rich.console import Console
from rich.table import Table

from atpid_sim.integration import FIDELITIES
from atpid_sim.scene import Scene, SceneError, load_scene
from atpid_sim.simulate import Result, simulate

_UNITS = {"amplitude": "m", "undamped_amplitude": "m", "wall_s": "s"}
_SHOWN = (
    "amplitude", "undamped_amplitude", "efficiency", "motion", "impacts", "fidelity", "left_out", "error_estimate",
    "reproducible", "spread", "energy_residual", "steps", "wall_s", "result",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", metavar="SCENE.yaml", help="everything the run needs (docs/scenes.md)")
    parser.add_argument(
        "--fidelity", default="auto", choices=("auto", *FIDELITIES), help="fidelity level; default: cheapest that fits"
    )
    parser.add_argument(
        "--rtol", type=tolerance, default=None, metavar="R", help="relative tolerance of the integration"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Run the scene and print its result; return 0. Raises SceneError, NumericalFailure."""
    scene = load_scene(args.scene)
    result = _simulate(scene, args.fidelity, args.rtol)
    if args.json:
        print(json.dumps(result.to_json(), allow_nan=False))
    else:
        _show(args.scene, scene, result)
    return 0


def tolerance(text: str) -> float:
    """Return a relative tolerance; raise argparse's error where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-13 <= value <= 1e-1:
        raise argparse.ArgumentTypeError(f"given {text}; allowed is a number from 1e-13 to 0.1")
    return value


def _simulate(scene: Scene, fidelity: str, rtol: float | None) -> Result:
    try:
        return simulate(scene, fidelity, rtol)
    except ValueError as error:
        # a fidelity that cannot take the scene is a user's error, not a defect of the program
        raise error if isinstance(error, SceneError) else SceneError(str(error)) from None


def _show(name: str, scene: Scene, result: Result) -> None:
    values = result.to_json()
    table = Table(title=name, show_header=False)
    for key in _SHOWN:
        table.add_row(key, _text(values[key]), _UNITS.get(key, ""))
    console = Console()
    console.print(table)
    for line in scene.defaults():
        console.print(f"default: {line}", highlight=False, markup=False)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return ", ".join(map(_text, value)) if isinstance(value, list | tuple) else str(value)
