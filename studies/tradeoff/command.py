# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies tradeoff`: the speed-accuracy table of a scene (JSON, Markdown) and its picture (PNG)."""

import argparse
import json
import math
from dataclasses import asdict
from typing import Any

from rich.console import Console

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_sim.commands.tradeoff import as_json, draw, table
from atpid_sim.scene import load_scene
from atpid_sim.tradeoff import Point, Reference, reference_of, with_front
from studies.tradeoff import measure as study

#: The two LSODA as the tables name them.
_NAMES = {"lsoda": "scipy LSODA", "odeint": "odeint"}
#: Arguments of the example in the help.
EXAMPLE = "scenes/standard.yaml --out out/tradeoff"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="what to measure on (docs/scenes.md)")
    help_out = "folder for tradeoff.json, tradeoff.md, tradeoff.png"
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help=help_out)
    help_limit = "a method slower than this [s] stops getting finer"
    parser.add_argument("--patience", type=positive("s"), default=study.TIME_LIMIT, metavar="S", help=help_limit)


def run(args: argparse.Namespace) -> int:
    """Measure everything on one scene; return 0. Raises SceneError, OutputError, NumericalFailure."""
    scene = load_scene(args.scene)
    scene.require_prescribed_ceiling()
    console = Console(stderr=True)
    folder = output.folder(args.out)
    with console.status("reference") as status:
        reference = reference_of(scene)
        points: list[Point] = []
        for point in study.measure(scene, reference, args.patience):
            points.append(point)
            status.update(f"{point.method} {point.tolerance:g}: {1e3 * point.time_s:.2f} ms")
        status.update("steady motion")
        steady = study.steady_trade(scene)
    points = with_front(points)
    found, finest = ([], []) if reference.spread else (study.answers(points), study.tightest(points))
    text = _markdown(args.scene.name, reference, points, found + finest) + _steady(steady)
    plain = {
        **as_json(args.scene.name, reference, points),
        "answers": found,
        "tightest": finest,
        "steady": None if steady is None else output.finite(asdict(steady)),
    }
    with output.writing(folder):
        (folder / "tradeoff.json").write_text(json.dumps(plain, indent=1) + "\n")
        (folder / "tradeoff.md").write_text(text, encoding="utf-8")
        draw(args.scene.stem, reference, points, folder / "tradeoff.png")
    print(text)
    return 0


def _markdown(name: str, reference: Reference, points: list[Point], found: list[dict[str, Any]]) -> str:
    lines = table(name, reference, points)
    if found:
        lines.append("| error of the amplitude | run | time [ms] | scipy LSODA [ms] | ratio | odeint [ms] | ratio |")
        lines += ["|---|---|---|---|---|---|---|", *map(_answer, found)]
    else:
        lines.append("No ratio to LSODA: where no tolerance reproduces the amplitude, no method meets an error level.")
    return "\n".join([*lines, ""])


def _steady(steady: study.Steady | None) -> str:
    if steady is None:
        return "\nNo steady motion: a run is all there is.\n"
    solved = f"{1e3 * steady.time_s:.3g} ms, error {steady.error:.1e}"
    waited = f"a run of {steady.waited_until:.0f} s comes to {steady.waited_error:.1e}"
    if math.isfinite(steady.waited_time_s):
        share = steady.time_s / steady.waited_time_s
        waited += f" in {1e3 * steady.waited_time_s:.3g} ms; ratio {share:.2g}"
    return f"\nSteady motion {steady.amplitude:.10g} m, solved for (`simulate --steady`) in {solved}; {waited}.\n"


def _answer(answer: dict[str, Any]) -> str:
    error = f"{answer['error']:.2g}"
    if "of" in answer:
        error += f", the tightest {_NAMES[answer['of']]} and ours both meet"
    cells = [error, answer["run"] or "none of ours", _number(answer["time_s"], 1e3)]
    for method in study.LSODA:
        best = answer[f"{method}_best"]
        missing = "not run" if best is None else f"not reached: {best:.1e} at its finest run"
        cells.append(_number(answer[f"{method}_time_s"], 1e3) or missing)
        cells.append(_number(answer[f"{method}_ratio"], 1.0))
    return f"| {' | '.join(cells)} |"


def _number(value: float | None, scale: float) -> str:
    return "" if value is None else f"{scale * value:.3g}"
