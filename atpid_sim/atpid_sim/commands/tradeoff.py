# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid tradeoff SCENE`: every fidelity level and tolerance beside a converged reference, and what to take."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_common.files import Document
from atpid_sim.figure_style import LIGHT, WIDTH, drawn
from atpid_sim.scene import load_scene
from atpid_sim.tradeoff import LEVELS, REFERENCE, Point, Reference, levels, quickest, reference_of, with_front

#: Smallest error drawn, as a share of how well the reference itself is known.
_DRAWN = 1e-2
#: A marker for each method, since there are more of them than colours.
_MARKERS = "oooos^vDPX*<>dph"
#: Errors of the amplitude for which a level is named [-].
_ERRORS = (1e-2, 1e-3, 1e-4, 1e-6)
#: Arguments of the example in the help.
EXAMPLE = "scenes/standard.yaml --out out/tradeoff"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="what to measure on (docs/scenes.md)")
    parser.add_argument("--out", type=file_path, metavar="DIR", help="folder for tradeoff.json and the picture")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Measure on one scene and print; return 0. Raises SceneError, OutputError, NumericalFailure."""
    scene = load_scene(args.scene)
    scene.require_prescribed_ceiling()
    folder = output.folder(args.out) if args.out else None
    with Console(stderr=True).status("reference"):
        reference = reference_of(scene)
        points = with_front(list(levels(scene, reference)))
    plain = as_json(args.scene.name, reference, points) | {"take": _advice(points, reference)}
    if folder is not None:
        with output.writing(folder):
            (folder / "tradeoff.json").write_text(json.dumps(plain, indent=1) + "\n")
            draw(args.scene.stem, reference, points, folder / "tradeoff.png")
    print(json.dumps(plain) if args.json else "\n".join([*table(args.scene.name, reference, points), plain["take"]]))
    return 0


def as_json(name: str, reference: Reference, points: Sequence[Point]) -> Document:
    """Return scene, reference and points by name; what is not finite is None."""
    return {
        "scene": name,
        "reference": {key: getattr(reference, key) for key in ("amplitude", "agreement", "spread")},
        "points": [output.finite(asdict(point)) for point in points],
    }


def _advice(points: Sequence[Point], reference: Reference) -> str:
    """Return which level to take for which error of the amplitude, in a sentence."""
    if reference.spread is not None:
        return "No level can be recommended: no tolerance reproduces the amplitude."
    named = []
    for error in _ERRORS:
        best = quickest(points, error)
        if best is None:
            named.append(f"for {error:g} none is near enough")
        else:
            named.append(f"for {error:g} take {best.method} at {best.tolerance:g} ({1e3 * best.time_s:.3g} ms)")
    return f"On this machine: {', '.join(named)}."


def table(name: str, reference: Reference, points: Sequence[Point]) -> list[str]:
    """Return the lines of a Markdown table of the points."""
    lines = [f"Scene `{name}`; {_description(reference)}", ""]
    middle = "amplitude error | trajectory error" if reference.spread is None else "amplitude [m] | inside the spread"
    lines += [f"| method | tolerance | time [ms] | {middle} | energy residual | |", "|---|---|---|---|---|---|---|"]
    return [*lines, *(_row(point, reference) for point in points), ""]


def _description(reference: Reference) -> str:
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


def draw(name: str, reference: Reference, points: Sequence[Point], path: Path) -> None:
    """Draw time against error into a picture; what is not ours is dashed."""
    shown = [p for p in points if math.isfinite(p.amplitude_error) and math.isfinite(p.time_s)]
    known = _known(reference)
    errors = {p: max(p.amplitude_error, _DRAWN * known) for p in shown}
    bottom = 0.4 * min([known, *errors.values()])
    band, off, title = "better than the reference is known", "error of the amplitude [-]", f"{name}: time against error"
    if reference.spread is not None:
        band = "closer than the ensemble is wide"
        off = f"distance from the amplitude of one run at {REFERENCE:g} [-]"
        title += " (chaotic: no method can converge)"
    with drawn(path, dpi=130, figsize=(WIDTH, 5.6)) as (figure, axes):
        for number, method in enumerate(dict.fromkeys(p.method for p in shown)):
            chosen = [p for p in shown if p.method == method]
            line, width, size = ("-", 1.8, 6.0) if method in LEVELS else ("--", 1.0, 5.0)
            colour, times = f"C{number % 10}", [1e3 * p.time_s for p in chosen]
            curve = [errors[p] for p in chosen]
            axes.plot(times, curve, f"{colour}{line}{_MARKERS[number]}", linewidth=width, markersize=size)
            place, side = (times[0], curve[0]), "right" if method == "finite" else "center"
            axes.annotate(method, place, (0, 8), textcoords="offset points", color=colour, weight="bold", ha=side)
        if reference.spread is None:
            front = sorted((p for p in shown if p.front), key=lambda p: p.time_s)
            times = [1e3 * p.time_s for p in front]
            rings = axes.plot(times, [errors[p] for p in front], "ko", label="nothing better (front)")
            rings[0].set(markersize=13, fillstyle="none")
        axes.axhspan(bottom, known, color=LIGHT.window, zorder=0, label=band)
        axes.set(xscale="log", yscale="log", xlabel="time of one run [ms]", ylabel=off, title=title)
        axes.set_ylim(bottom=bottom)
        axes.margins(x=0.08)
        figure.legend(ncols=2, loc="outside lower center")


def _known(reference: Reference) -> float:
    """Return the relative uncertainty of the reference's amplitude: smaller errors are not resolved."""
    if reference.spread is None:
        return max(reference.agreement, REFERENCE)
    return max((reference.spread[2] - reference.spread[0]) / reference.amplitude, REFERENCE)
