# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid cliffs`: the periodic motion over the height through its folds, and where it ends over a second parameter."""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path, path_to, rising
from atpid_common.files import Document
from atpid_sim.commands.options import add_table, write_table
from atpid_sim.display import working
from atpid_sim.figure_style import drawn
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene

_Range = tuple[float, float]
_CURVES = "branch", "bifurcation", "cliff"
#: Tolerance of the runs that make up a return map.
_RTOL = 1e-10
EXAMPLE = "scenes/standard.yaml --height 0.19:0.3 --frequencies 5.2:5.75 --picture cliffs.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="the system, and its excitation by a tone")
    heights = rising(0.0, 1e3, "LO:HI with 0 < LO < HI, at most 1000", closed=False)
    help_height = "heights [m]; followed is the motion that the scene ends in at LO"
    parser.add_argument("--height", type=heights, required=True, metavar="LO:HI", help=help_height)
    second = parser.add_mutually_exclusive_group()
    drives = "follow the cliff over these amplitudes of the support [m] or of the force [N], around the scene's"
    second.add_argument("--amplitudes", type=heights, metavar="LO:HI", help=drives)
    frequencies = rising(0.0, 1e6, "LO:HI with 0 < LO < HI, at most 1e6 Hz", closed=False)
    help_frequencies = "follow it over these frequencies [Hz], around the scene's"
    second.add_argument("--frequencies", type=frequencies, metavar="LO:HI", help=help_frequencies)
    parser.add_argument("--picture", type=path_to(".png"), metavar="FILE.png", help="draw branch and cliff here")
    add_table(parser, "write all points here")


def run(args: argparse.Namespace) -> int:
    """Follow branch and cliff; return 0. Raises SceneError, OutputError, NumericalFailure."""
    scene = load_scene(args.scene)
    for option in ("out", "picture"):
        if getattr(args, option) is not None:
            output.file(getattr(args, option), f"--{option}", replace=args.force)
    with working("following (the first time the kernels are compiled, a minute or two)"):
        rows = points(scene, args.height, args.amplitudes, args.frequencies)
    write_table(rows, args.out)
    if args.picture is not None:
        draw(rows, "frequency" if args.frequencies else "amplitude", args.picture, scene.drive)
    found = {curve: [row for row in rows if row["curve"] == curve] for curve in _CURVES}
    if args.json:
        print(json.dumps(found, allow_nan=False))
        return 0
    for row in found["bifurcation"]:
        end = ": the stable motion ends" if row["stable"] else ""
        print(f"{1e3 * row['height']:10.4f} mm  {row['what']}{end}")
    print(f"{len(found['branch'])} motions of the branch, {len(found['cliff'])} points of the cliff")
    return 0


def points(
    scene: Scene, heights: _Range, amplitudes: _Range | None = None, frequencies: _Range | None = None
) -> list[Document]:
    """Return the points of the branch over the heights [m], its bifurcations, and its cliff over a second parameter.

    `stable` is whether a motion of the branch is, or whether a bifurcation ends the stability. Raises SceneError,
    NumericalFailure.
    """
    from atpid_dynamics.continuation import follow_branch, follow_cliff
    from atpid_sim.periodic import Conditions, ReturnMap, solve, steady_state
    from atpid_sim.simulation.fidelity import complete_fidelity
    from atpid_sim.simulation.integration import Integration

    name, span = ("amplitude", amplitudes) if amplitudes else ("frequency", frequencies)
    low = scene.with_(height=heights[0])
    search = steady_state(low)
    motion, reason = None, search.ending.value
    if search.state is not None:
        conditions = Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, heights[0])
        own = getattr(conditions, name)
        if span is not None and not span[0] < own < span[1]:
            raise SceneError(f"excitation.{name}: given {own:g}; its cliff is followed inside {span[0]:g}:{span[1]:g}")
        integration = Integration(low, complete_fidelity(low), _RTOL)
        returns = ReturnMap(integration, conditions, search.state.phase, search.state.periods)
        found = solve(returns, search.state.section)
        motion, reason = found.motion, found.ending.value
    if motion is None:
        raise NumericalFailure(f"--height: at {heights[0]:g} m there is no motion to follow: {reason}")
    branch = follow_branch(integration, motion, {"height": heights})
    parts = [("branch", each, "", each.stability_margin > 0.0) for each in branch.motions]
    parts += [("bifurcation", each.motion, each.loss.name, each.ends_stability) for each in branch.bifurcations]
    if branch.cliff is not None and span is not None:
        ranges = {"height": (2.0 * scene.grain.radius, heights[1]), name: span}
        curve = follow_cliff(integration, branch.cliff, ranges)
        parts += [("cliff", each.motion, each.loss.name, True) for each in curve]
    rows = []
    for curve_name, each, what, stable in parts:
        sizes = {"beam_amplitude": each.amplitude, "largest_multiplier": each.largest_multiplier}
        of_kind = {"what": what.lower(), "stable": stable}
        rows.append({"curve": curve_name, **each.conditions._asdict(), **sizes, **of_kind})
    return rows


def draw(rows: list[Document], second: str, path: Path, drive: str = "support") -> None:
    """Draw the points that `points` returns, the cliff over the drive's parameter `second`. Raises OutputError."""
    unit, scale = ("Hz", 1.0) if second == "frequency" else ("N", 1.0) if drive == "force" else ("mm", 1e3)
    branch, bifurcations, cliff = ([row for row in rows if row["curve"] == name] for name in _CURVES)
    colours = {what: f"C{k}" for k, what in enumerate(dict.fromkeys(row["what"] for row in bifurcations + cliff), 1)}
    with drawn(path, "--picture", ncols=2, figsize=(10.0, 4.2)) as (_, (left, right)):
        for label, line in (("unstable", ":"), ("stable", "-")):  # what is stable is drawn over it
            shown = [1e3 * row["height"] if row["stable"] or label == "unstable" else math.nan for row in branch]
            left.plot(shown, [1e3 * row["beam_amplitude"] for row in branch], f"C0{line}", label=label)
        left.set(title="The branch", xlabel="height [mm]", ylabel="amplitude of the beam [mm]")
        right.set(title="The cliff", xlabel=f"{second} of the {drive} [{unit}]", ylabel="height [mm]")
        for what, colour in colours.items():
            at = [row for row in bifurcations if row["what"] == what]
            points = [1e3 * row["height"] for row in at], [1e3 * row["beam_amplitude"] for row in at]
            left.plot(*points, "o", color=colour, label=what if at else None)
            heights = [1e3 * row["height"] if row["what"] == what else math.nan for row in cliff]
            if not np.isnan(heights).all():
                right.plot([scale * row[second] for row in cliff], heights, ".-", color=colour, label=what)
        for axes in (left, right):
            if axes.lines:
                axes.legend()
