# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid select`: the ceiling height for a scene's excitation, by one of the methods."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from atpid_common.arguments import file_path, positive, real
from atpid_common.output import finite
from atpid_control.selection.checks import range_warnings
from atpid_control.selection.protocol import (
    TAKES,
    Excitation,
    HeightSelector,
    Options,
    Selection,
    SelectionError,
    box_in_words,
)
from atpid_control.selection.registry import make_selector, methods
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.excitation import steady_amplitude
from atpid_sim.simulation.quantities import efficiency, worse_than_without

EXAMPLE = "scenes/thesis_4_3.yaml --method pca"
_USUAL = Options()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, metavar="SCENE.yaml", help="the system and its excitation")
    choices = [name for name in methods() if name != "fixed"]
    add("--method", choices=choices, help="how the height is selected; default: the scene's controller")
    add("--map", type=file_path, default=None, metavar="MAP.npz", help="for lookup; default: one that fits")
    std = "of the amplitude [m], or [N] under a force; default 0"
    add("--amplitude-std", type=real(0.0, 1e3), default=0.0, metavar="S", help=std)
    margin = "standard deviations to be safe for; default 0"
    add("--margin", type=real(0.0, 100.0), default=0.0, metavar="K", help=margin)
    stiffness = f"direct only: relative error of the model's stiffness; default {_USUAL.stiffness_uncertainty}"
    add("--stiffness-uncertainty", type=real(0.0, 0.5), metavar="U", help=stiffness)
    add("--deadline", type=positive("s"), metavar="S", help="direct only: time for a margin [s]; default none")
    gravity = "pca only: all models without gravity (Fig. 4.43)"
    add("--without-gravity", dest="gravity", action="store_const", const=False, help=gravity)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Select and print; return 0. Raises SceneError, MapError, SelectionError, NumericalFailure."""
    scene = load_scene(args.scene)
    args.method = args.method or scene.ceiling.controller
    if not args.method:
        raise SelectionError("--method: not given, and the scene's ceiling has no controller; give one (--help)")
    if scene.excitation.is_stationary:
        return _by_rms(args, scene)
    amplitude = steady_amplitude(scene)
    selector = _selector(args, scene)
    try:
        chosen = selector.select(Excitation(amplitude, args.amplitude_std), args.margin)
    except SelectionError as error:
        # in the loop a simulation that fails is one more reason to stay; for a user it is a failure of its own kind
        if isinstance(error.__cause__, NumericalFailure):
            raise NumericalFailure(f"{error.__cause__}{scene.hint()}") from None
        raise
    bare = scene.linear_amplitude(amplitude, scene.frequency_hz, grain=False)
    _give(args, scene, chosen, bare, f"{chosen.method} at {amplitude:g} {scene.driven_by.unit}")
    return 0


def _by_rms(args: argparse.Namespace, scene: Scene) -> int:
    """Select by root mean square and print; return 0. Raises SelectionError."""
    names = ("margin", "amplitude_std", "deadline", "stiffness_uncertainty")
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(args, name)]
    if args.method != "direct" or given:
        raise SelectionError(
            f"excitation: given a {scene.excitation.kind} one with {', '.join([f'method {args.method}', *given])}; "
            "allowed: method direct alone, which selects by root mean square, or a tone {amplitude, frequency}"
        )
    from atpid_control.selection.by_rms import least_rms

    chosen, bare, unsure = least_rms(scene)
    _give(args, scene, chosen, bare, "direct, by root mean square", unsure)
    return 0


def _give(
    args: argparse.Namespace, scene: Scene, chosen: Selection, bare: float, title: str, unsure: Sequence[str] = ()
) -> None:
    """Print the selection; `bare`: amplitude of the beam without the damper [m], or its root mean square."""
    reduction = efficiency(chosen.beam_amplitude, bare)
    warnings = [*scene.warnings(), *range_warnings(scene, chosen), *unsure, *worse_than_without(reduction)]
    if args.json:
        shown = asdict(chosen)
        shown["amplitude"] = shown.pop("beam_amplitude")
        shown |= {"bare_amplitude": bare, "reduction": reduction, "warnings": warnings}
        shown["resonance"] = scene.natural_frequency_hz
        if scene.excitation.is_stationary:
            shown["measure"] = "root mean square"
        print(json.dumps(finite(shown), allow_nan=False))
    else:
        _show(f"{args.scene}: {title}", scene, chosen, warnings, bare)


def _selector(args: argparse.Namespace, scene: Scene) -> HeightSelector:
    options = ("stiffness_uncertainty", "deadline", "gravity")
    given = {name: value for name in options if (value := getattr(args, name)) is not None}
    for name in given:
        if name not in TAKES.get(args.method, ()):
            taking = ", ".join(method for method, taken in TAKES.items() if name in taken)
            option = "--without-gravity" if name == "gravity" else f"--{name.replace('_', '-')}"
            raise SelectionError(f"{option}: given with method {args.method}; allowed with {taking}")
    return make_selector(args.method, scene, _map(args, scene), replace(_USUAL, **given))


def _map(args: argparse.Namespace, scene: Scene) -> Path | None:
    chosen: Path | None = args.map
    if chosen is not None or args.method != "lookup":
        return chosen
    from atpid_control.selection.map_cache import map_for

    closed = 2.0 * scene.grain.radius
    looked_up = {"closed": closed, "range": [closed, 1e3], "speed": 1.0, "controller": "lookup"}
    if scene.ceiling.map is not None:
        looked_up["map"] = str(scene.ceiling.map)
    return map_for(scene.with_(ceiling=looked_up))


def _show(title: str, scene: Scene, chosen: Selection, warnings: list[str], bare: float) -> None:
    measure = "RMS of the beam" if scene.excitation.is_stationary else "beam amplitude"
    table = Table(title=title, show_header=False)
    rows = {
        "height": f"{chosen.height:.4f} m",
        f"{measure} there": f"{chosen.beam_amplitude:.4f} m",
        "efficiency, against the damper closed": f"{100 * chosen.efficiency:.1f} %",
        f"{measure} without the damper": f"{bare:.4f} m",
        "reduction, against that": f"{100 * efficiency(chosen.beam_amplitude, bare):.1f} %",
        "price of the margin": f"{100 * chosen.price:.2f} %",
        "resonance, damper closed": f"{scene.natural_frequency_hz:.4f} Hz",
        "simulations": str(chosen.evaluations),
        "time": f"{1e3 * chosen.wall_s:.1f} ms",
    }
    if chosen.box:
        rows["the margin is for"] = box_in_words(chosen.box)
    for name, text in rows.items():
        table.add_row(name, "unknown" if text.startswith("nan") else text)
    console = Console()
    console.print(table)
    if chosen.stages:
        steps = Table("stage", "height [m]", f"{measure} [m]", "")
        for stage in chosen.stages:
            shown = ("" if math.isnan(value) else f"{value:.4f}" for value in (stage.height, stage.amplitude))
            steps.add_row(stage.name, *shown, stage.note)
        console.print(steps)
    for line in (chosen.no_use, "" if chosen.stages else chosen.note):
        if line:
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    for line in warnings:
        console.print(f"warning: {line}", highlight=False, markup=False, soft_wrap=True)
