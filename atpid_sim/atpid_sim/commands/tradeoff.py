# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim tradeoff`: the speed-accuracy table of a scene (JSON, Markdown) and its picture (PNG)."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from atpid_common import output
from atpid_sim.figure_numbers import metadata_of
from atpid_sim.scene import load_scene
from atpid_sim.studies.tradeoff import (
    LSODA,
    OURS,
    REFERENCE,
    TIME_LIMIT,
    Point,
    Reference,
    answers,
    measure,
    reference_of,
    tightest,
    with_front,
)

#: Smallest error drawn, as a share of how well the reference itself is known.
_DRAWN = 1e-2
#: The two LSODA as the tables name them.
_NAMES = {"lsoda": "scipy LSODA", "odeint": "odeint"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", metavar="SCENE.yaml", help="what to measure on (docs/scenes.md)")
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="folder for tradeoff.json, tradeoff.md, tradeoff.png"
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=TIME_LIMIT,
        metavar="S",
        help="a method slower than this [s] stops getting finer",
    )


def run(args: argparse.Namespace) -> int:
    """Measure everything on one scene; return 0. Raises SceneError, OutputError, NumericalFailure."""
    scene = load_scene(args.scene)
    scene.require_prescribed_ceiling()
    console = Console(stderr=True)
    folder = output.folder(Path(args.out))
    with console.status("reference") as status:
        reference = reference_of(scene)
        points: list[Point] = []
        for point in measure(scene, reference, args.patience):
            points.append(point)
            status.update(f"{point.method} {point.tolerance:g}: {1e3 * point.time_s:.2f} ms")
    points = with_front(points)
    found, finest = ([], []) if reference.spread else (answers(points), tightest(points))
    text = _markdown(Path(args.scene).name, reference, points, found + finest)
    plain = _plain(args.scene, reference, points, found) | {"tightest": finest}
    with output.writing(folder):
        (folder / "tradeoff.json").write_text(json.dumps(plain, indent=1) + "\n")
        (folder / "tradeoff.md").write_text(text, encoding="utf-8")
        _draw(Path(args.scene).stem, reference, points, folder / "tradeoff.png")
    print(text)
    return 0


def _plain(scene: str, reference: Reference, points: list[Point], found: list[dict[str, Any]]) -> dict[str, Any]:
    rows = [
        {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(p).items()} for p in points
    ]
    return {
        "scene": Path(scene).name,
        "reference": {
            "amplitude": reference.amplitude,
            "agreement": reference.agreement,
            "spread": reference.spread,
        },
        "points": rows,
        "answers": found,
    }


def _markdown(name: str, reference: Reference, points: list[Point], found: list[dict[str, Any]]) -> str:
    lines = [f"Scene `{name}`; {_said(reference)}", ""]
    if reference.spread is None:
        lines += ["| method | tolerance | time [ms] | amplitude error | trajectory error | energy residual | |"]
    else:
        lines += ["| method | tolerance | time [ms] | amplitude [m] | inside the spread | energy residual | |"]
    lines += ["|---|---|---|---|---|---|---|"]
    lines += [_row(point, reference) for point in points]
    lines.append("")
    if found:
        lines += ["| error of the amplitude | run | time [ms] | scipy LSODA [ms] | ratio | odeint [ms] | ratio |"]
        lines += ["|---|---|---|---|---|---|---|"]
        lines += [_answer(answer) for answer in found]
    else:
        lines.append("No ratio to LSODA: where no tolerance reproduces the amplitude, no method meets an error level.")
    return "\n".join([*lines, ""])


def _said(reference: Reference) -> str:
    if reference.spread is None:
        return f"reference {reference.amplitude:.12g} m, two tolerances agree to {reference.agreement:.0e}."
    low, middle, high = reference.spread
    return (
        f"chaotic: tolerances of 1e-11 and 1e-12 differ by {reference.agreement:.0%}, so there is nothing to be near. "
        f"An ensemble of starts 1e-6 apart gives {low:.4g} to {high:.4g} m, median {middle:.4g} m: what a single "
        "run gives, by any method, is one draw."
    )


def _row(point: Point, reference: Reference) -> str:
    residual = "" if point.energy_residual is None else f"{point.energy_residual:.0e}"
    note = point.note + (" **front**" if point.front and reference.spread is None else "")
    if reference.spread is None:
        middle = f"{point.amplitude_error:.1e} | {point.trajectory_error:.1e}"
    else:
        inside = reference.spread[0] <= point.amplitude <= reference.spread[2]
        middle = f"{point.amplitude:.5g} | {'yes' if inside else 'no'}"
    return (
        f"| {point.method} | {point.tolerance:g} | {1e3 * point.time_s:.3g} | {middle} | {residual} | {note.strip()} |"
    )


def _answer(answer: dict[str, Any]) -> str:
    error = f"{answer['error']:.2g}"
    if "of" in answer:
        error += f", the tightest {_NAMES[answer['of']]} and ours both meet"
    cells = [error, answer["run"] or "none of ours", _number(answer["time_s"], 1e3)]
    for method in LSODA:
        best = answer[f"{method}_best"]
        missing = "not run" if best is None else f"not reached: {best:.1e} at its finest run"
        cells.append(_number(answer[f"{method}_time_s"], 1e3) or missing)
        cells.append(_number(answer[f"{method}_ratio"], 1.0))
    return f"| {' | '.join(cells)} |"


def _number(value: float | None, scale: float) -> str:
    return "" if value is None else f"{scale * value:.3g}"


def _draw(name: str, reference: Reference, points: list[Point], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9.0, 5.5), layout="constrained")
    drawn = [p for p in points if math.isfinite(p.amplitude_error) and math.isfinite(p.time_s)]
    known = _known(reference)
    errors = {p: max(p.amplitude_error, _DRAWN * known) for p in drawn}
    for number, method in enumerate(dict.fromkeys(p.method for p in drawn)):
        chosen = [p for p in drawn if p.method == method]
        own = method in OURS
        axes.plot(
            [1e3 * p.time_s for p in chosen], [errors[p] for p in chosen],
            marker="o" if own else "s", linestyle="-" if own else "--", linewidth=1.8 if own else 1.0,
            markersize=6 if own else 4, color=f"C{number}" if number < 10 else "k", label=method,
        )  # fmt: skip
    if reference.spread is None:
        front = sorted((p for p in drawn if p.front), key=lambda p: p.time_s)
        axes.plot(
            [1e3 * p.time_s for p in front], [errors[p] for p in front],
            "o", markersize=13, fillstyle="none", color="k", linestyle="none", label="nothing better (front)",
        )  # fmt: skip
    bottom = 0.4 * min([known, *errors.values()])
    band, off, title = "better than the reference is known", "error of the amplitude [-]", f"{name}: time against error"
    if reference.spread is not None:
        band, off = "closer than the ensemble is wide", f"distance from the amplitude of one run at {REFERENCE:g} [-]"
        title += " (chaotic: no method can converge)"
    axes.axhspan(bottom, known, color="0.9", zorder=0, label=band)
    axes.set(xscale="log", yscale="log", xlabel="time of one run [ms]", ylabel=off, title=title)
    axes.set_ylim(bottom=bottom)
    axes.grid(visible=True, which="major", alpha=0.3)
    figure.legend(fontsize=8, ncols=5, loc="outside lower center")
    figure.savefig(path, dpi=130, metadata=metadata_of(figure))
    pyplot.close(figure)


def _known(reference: Reference) -> float:
    """Return the relative uncertainty of the reference's amplitude: smaller errors are not resolved."""
    if reference.spread is None:
        return max(reference.agreement, REFERENCE)
    return max((reference.spread[2] - reference.spread[0]) / reference.amplitude, REFERENCE)
