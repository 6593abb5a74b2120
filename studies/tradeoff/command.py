# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies tradeoff`: the speed-accuracy table of a scene (JSON, Markdown) and its picture (PNG)."""

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_sim.figure_style import LIGHT, WIDTH, drawn
from atpid_sim.scene import load_scene
from studies.tradeoff import measure as study

#: Smallest error drawn, as a share of how well the reference itself is known.
_DRAWN = 1e-2
_OWN_STYLE: dict[str, Any] = {"linestyle": "-", "linewidth": 1.8, "markersize": 6}
_BASELINE_STYLE: dict[str, Any] = {"linestyle": "--", "linewidth": 1.0, "markersize": 5}
#: A marker for each method, since there are more of them than colours.
_MARKERS = "oooos^vDPX*<>dph"
_RING: dict[str, Any] = {"markersize": 13, "fillstyle": "none", "linestyle": "none"}
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
        reference = study.reference_of(scene)
        points: list[study.Point] = []
        for point in study.measure(scene, reference, args.patience):
            points.append(point)
            status.update(f"{point.method} {point.tolerance:g}: {1e3 * point.time_s:.2f} ms")
        status.update("steady motion")
        steady = study.steady_trade(scene)
    points = study.with_front(points)
    found, finest = ([], []) if reference.spread else (study.answers(points), study.tightest(points))
    text = _markdown(args.scene.name, reference, points, found + finest) + _steady(steady)
    plain = {
        "scene": args.scene.name,
        "reference": {name: getattr(reference, name) for name in ("amplitude", "agreement", "spread")},
        "points": [output.finite(asdict(point)) for point in points],
        "answers": found,
        "tightest": finest,
        "steady": None if steady is None else output.finite(asdict(steady)),
    }
    with output.writing(folder):
        (folder / "tradeoff.json").write_text(json.dumps(plain, indent=1) + "\n")
        (folder / "tradeoff.md").write_text(text, encoding="utf-8")
        _draw(args.scene.stem, reference, points, folder / "tradeoff.png")
    print(text)
    return 0


def _markdown(name: str, reference: study.Reference, points: list[study.Point], found: list[dict[str, Any]]) -> str:
    lines = [f"Scene `{name}`; {_description(reference)}", ""]
    middle = "amplitude error | trajectory error" if reference.spread is None else "amplitude [m] | inside the spread"
    lines += [f"| method | tolerance | time [ms] | {middle} | energy residual | |", "|---|---|---|---|---|---|---|"]
    lines += [*(_row(point, reference) for point in points), ""]
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


def _description(reference: study.Reference) -> str:
    if reference.spread is None:
        return f"reference {reference.amplitude:.12g} m, two tolerances agree to {reference.agreement:.0e}."
    low, middle, high = reference.spread
    return (
        f"chaotic: tolerances of 1e-11 and 1e-12 differ by {reference.agreement:.0%}, so there is nothing to be near. "
        f"An ensemble of starts 1e-6 apart gives {low:.4g} to {high:.4g} m, median {middle:.4g} m: what a single "
        "run gives, by any method, is one draw."
    )


def _row(point: study.Point, reference: study.Reference) -> str:
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
    for method in study.LSODA:
        best = answer[f"{method}_best"]
        missing = "not run" if best is None else f"not reached: {best:.1e} at its finest run"
        cells.append(_number(answer[f"{method}_time_s"], 1e3) or missing)
        cells.append(_number(answer[f"{method}_ratio"], 1.0))
    return f"| {' | '.join(cells)} |"


def _number(value: float | None, scale: float) -> str:
    return "" if value is None else f"{scale * value:.3g}"


def _draw(name: str, reference: study.Reference, points: list[study.Point], path: Path) -> None:
    shown = [p for p in points if math.isfinite(p.amplitude_error) and math.isfinite(p.time_s)]
    known = _known(reference)
    errors = {p: max(p.amplitude_error, _DRAWN * known) for p in shown}
    bottom = 0.4 * min([known, *errors.values()])
    band, off, title = "better than the reference is known", "error of the amplitude [-]", f"{name}: time against error"
    if reference.spread is not None:
        band, off = (
            "closer than the ensemble is wide",
            f"distance from the amplitude of one run at {study.REFERENCE:g} [-]",
        )
        title += " (chaotic: no method can converge)"
    with drawn(path, dpi=130, figsize=(WIDTH, 5.6)) as (figure, axes):
        for number, method in enumerate(dict.fromkeys(p.method for p in shown)):
            chosen = [p for p in shown if p.method == method]
            style = _OWN_STYLE if method in study.OURS else _BASELINE_STYLE
            style = {**style, "color": f"C{number % 10}", "marker": _MARKERS[number]}
            times = [1e3 * p.time_s for p in chosen]
            axes.plot(times, [errors[p] for p in chosen], **style)
            place = {
                "xytext": (0.0, 8.0),
                "textcoords": "offset points",
                "ha": "right" if method == "finite" else "center",
            }
            axes.annotate(method, (times[0], errors[chosen[0]]), color=style["color"], weight="bold", **place)
        if reference.spread is None:
            front = sorted((p for p in shown if p.front), key=lambda p: p.time_s)
            times = [1e3 * p.time_s for p in front]
            axes.plot(times, [errors[p] for p in front], "ko", **_RING, label="nothing better (front)")
        axes.axhspan(bottom, known, color=LIGHT.window, zorder=0, label=band)
        axes.set(xscale="log", yscale="log", xlabel="time of one run [ms]", ylabel=off, title=title)
        axes.set_ylim(bottom=bottom)
        axes.margins(x=0.08)
        figure.legend(ncols=2, loc="outside lower center")


def _known(reference: study.Reference) -> float:
    """Return the relative uncertainty of the reference's amplitude: smaller errors are not resolved."""
    if reference.spread is None:
        return max(reference.agreement, study.REFERENCE)
    return max((reference.spread[2] - reference.spread[0]) / reference.amplitude, study.REFERENCE)
