# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid modes`: the modes of a structure as a scene has them, from dimensions, a file of modes or a recorded run."""

import argparse
import json
import math
import re
import sys

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path, positive, real, refuse, whole
from atpid_common.cli import Command
from atpid_common.files import Document
from atpid_control.analysis.signals import signals_of
from atpid_control.commands.results import add_block, add_part, give_block, print_missing
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import open_run
from atpid_lab.modes import cantilever, from_run, universal_file
from atpid_lab.modes.structure import ModesError, Structure, choose, merged
from atpid_sim.contact.materials import MATERIALS
from atpid_sim.display import working
from atpid_sim.scene import load_scene
from atpid_sim.scene.yaml12 import write_yaml


def _add_cantilever(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    sizes = {"length": "from clamp to container", "width": "of the section", "thickness": "in the motion's direction"}
    for name, what in sizes.items():
        add(f"--{name}", type=positive("m"), required=True, metavar="M", help=f"{what} [m]")
    add("--material", choices=sorted(MATERIALS), help="modulus and density by name, in place of the next two")
    add("--modulus", type=real(1.0, 1e13, "Pa"), metavar="PA", help="Young's modulus [Pa]")
    add("--density", type=positive("kg/m^3"), metavar="KG/M3", help="density [kg/m^3]")
    add("--tip-mass", type=real(0.0, 1e6, "kg"), required=True, metavar="KG", help="container without the grain [kg]")
    inertia = "its moment of inertia about the beam's tip [kg m^2]; default: 0"
    add("--tip-inertia", type=real(0.0, 1e6, "kg m^2"), default=0.0, metavar="KGM2", help=inertia)
    where = "a force at X from the clamp drives the beam, and not its base [m]"
    add("--force-at", type=positive("m"), metavar="X", help=where)
    _add_modes(parser, required=True)


def _add_file(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("modes_file", type=file_path, metavar="MODES.unv", help="universal file with data sets 55, in SI or with 164")
    container = "node of the container and direction of its motion and the base's, such as 12:z or 12:-y"
    add("--container", type=_place, required=True, metavar="NODE:DIRECTION", help=container)
    where = "a force there drives the structure, and not its base"
    add("--force-at", type=_place, metavar="NODE:DIRECTION", help=where)
    _add_modes(parser, required=False)


def _add_run(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    recording = "a run with the container empty, or the damper closed: a bag or a .csv"
    add("recording", type=file_path, metavar="RUN", help=recording)
    add_part(parser, "begin of the part used")
    masses = "of the modes as recorded, needed but where a force at the container drives them [kg]"
    add("--masses", type=positive("kg"), nargs="+", metavar="KG", help=masses)
    grain = "what the closed damper held, which is taken away, under a force at the container [kg]; default: 0"
    add("--grain-mass", type=real(0.0, 1e6, "kg"), default=0.0, metavar="KG", help=grain)
    _add_modes(parser, required=True)


def _add_modes(parser: argparse.ArgumentParser, *, required: bool) -> None:
    add = parser.add_argument
    count = "how many, from the lowest" + ("" if required else "; default: all that move the container")
    add("--modes", type=whole(1, cantilever.MOST_MODES), required=required, metavar="N", help=count)
    ratio = "damping over critical damping, one for all modes or one a mode [-]"
    add("--damping-ratio", type=real(0.0, 1.0), nargs="+", default=[], metavar="R", help=ratio)
    add("--scene", type=file_path, metavar="SCENE.yaml", help="give this scene with the modes in place of its own")
    add_block(parser, "the blocks, or the scene,")


def _place(text: str) -> universal_file.Place:
    """Return the node and the direction of NODE:DIRECTION."""
    if found := re.fullmatch(r"([0-9]{1,10}):([+-]?)([xyz])", text):
        return universal_file.Place(int(found[1]), "xyz".index(found[3]), -1.0 if found[2] == "-" else 1.0)
    return refuse(text, "NODE:DIRECTION, such as 12:z or 12:-y")


def _run_cantilever(args: argparse.Namespace) -> int:
    """Compute the modes and print the blocks; return 0. Raises ModesError, SceneError, OutputError."""
    if (args.material is None) == (args.modulus is None) or (args.modulus is None) != (args.density is None):
        raise ModesError("--material, --modulus, --density: allowed: --material, or --modulus and --density")
    solid = MATERIALS.get(args.material)
    modulus, density = (solid.young_modulus, solid.density) if solid else (args.modulus, args.density)
    stiffness, mass = modulus * args.width * args.thickness**3 / 12.0, density * args.width * args.thickness
    beam = cantilever.Cantilever(args.length, stiffness, mass * args.length, args.tip_mass, args.tip_inertia)
    return _give(args, cantilever.modes_of(beam, args.modes, args.force_at), forced=args.force_at is not None)


def _run_file(args: argparse.Namespace) -> int:
    """Read the modes and print the blocks; return 0. Raises ModesError, FileError, SceneError, OutputError."""
    structure = universal_file.modes_of(args.modes_file, args.container, args.force_at)
    return _give(args, structure, forced=args.force_at is not None)


def _run_run(args: argparse.Namespace) -> int:
    """Fit the modes and print them; return 0. Raises ModesError, BagError, AnalysisError, SceneError, OutputError."""
    run = open_run(bag_of(args.recording))
    forced = run.drive.name == "force"
    signals, missing = signals_of(run, both=False)
    print_missing(missing, sys.stderr)
    with working("fitting"):
        fit = from_run.fit_modes(signals.between(args.begin, args.end), args.modes, forced)
    if args.masses and len(args.masses) != args.modes:
        raise ModesError(f"--masses: given {len(args.masses)}; allowed: {args.modes}, one a mode")
    if args.grain_mass and (args.masses or not forced):
        raise ModesError("--grain-mass: allowed where a force at the container shows the masses; empty the container")
    driven = math.isfinite(fit.drive[0])
    left = f"residual {fit.residual:.3g} m of {fit.motion:.3g} m"
    lines = [f"{'driven' if driven else 'free'} motion, {fit.samples} samples, {left}"]
    if driven and (args.masses or forced):
        masses = np.array(args.masses) if args.masses else None
        structure, spread = from_run.structure_of(fit, masses, args.grain_mass, forced)
        for number, (f, z, m, by) in enumerate(spread, 1):
            lines.append(f"mode {number}: ± {f:.2g} Hz, ± {z:.2g} of critical, ± {m:.2g} kg, drive ± {by:.2g}")
        return _give(args, structure._replace(notes=(*lines, *structure.notes)), forced=forced)
    if args.scene is not None or args.out is not None:
        raise ModesError("--scene, --out: need masses: give --masses, or a run that a force at the container drives")
    deviations = fit.deviations()
    rows = zip(fit.frequency, fit.ratio, fit.drive, *deviations, strict=True)
    names = ("frequency", "damping_ratio", "drive_factor", "frequency_std", "damping_ratio_std", "drive_factor_std")
    modes = [dict(zip(names, map(float, row), strict=True)) for row in rows]
    for number, mode in enumerate(modes, 1):
        part = f", base's motion {mode['drive_factor']:.4g} ± {mode['drive_factor_std']:.2g}" if driven else ""
        ratio = f"damping ratio {mode['damping_ratio']:.4g} ± {mode['damping_ratio_std']:.2g}"
        lines.append(f"mode {number}: {mode['frequency']:.6g} ± {mode['frequency_std']:.2g} Hz, {ratio}{part}")
    lines.append("masses need --masses, or a run that a force at the container drives")
    found = output.finite({"modes": modes, "notes": lines})
    print(json.dumps(found) if args.json else "\n".join(f"# {one}" for one in lines))
    return 0


def _give(args: argparse.Namespace, structure: Structure, *, forced: bool) -> int:
    chosen = choose(structure, args.modes or len(structure.modes), args.damping_ratio, forced)
    given = chosen["blocks"]
    if args.scene is not None:
        given = merged(load_scene(args.scene), given, str(args.scene))
    text = "".join(f"# {line}\n" for line in _lines(chosen, forced)) + write_yaml(given)
    if args.out is not None:
        output.file(args.out, replace=args.force)
    return give_block(args, text, output.finite(chosen), text.rstrip())


def _lines(chosen: Document, forced: bool) -> list[str]:
    """Return what the numbers are, a line each."""
    lines = ["made by `atpid modes`; a mode's mass is what an impulse at the container meets, without the grain"]
    for number, mode in enumerate(chosen["modes"], 1):
        drive = f"shape where the force acts {mode['force']:.4g}" if forced else f"base's motion {mode['base']:.4g}"
        slope = "" if math.isnan(mode["slope"]) else f", slope {mode['slope']:.4g} rad/m"
        lines.append(f"mode {number}: {mode['frequency']:.5g} Hz, {mode['mass']:.4g} kg, {drive}{slope}")
    if forced:
        lines.append(f"a force of amplitude F is {chosen['amplitude_factor']:.5g} F in the scene, mode 1's part of it")
    elif len(chosen["modes"]) > 1:
        lines.append(f"modes left out have {chosen['left_of_base']:.2g} of the base's motion, added to the last mode")
    lines += [
        f"left out at the container: {100 * chosen['left_of_compliance']:.3g} % of the static compliance",
        f"an impulse there meets {chosen['impulse_mass']:.4g} kg, all these modes together",
    ]
    if after := chosen["next_mode"]:
        lines.append(f"next mode: {after['frequency']:.5g} Hz, {after['mass']:.4g} kg")
    return [*lines, *chosen["notes"]]


CANTILEVER = Command(
    _add_cantilever,
    _run_cantilever,
    "--length 0.4 --width 0.04 --thickness 0.008 --modulus 5.345e9 --density 2431 --tip-mass 0.25 "
    "--damping-ratio 0.024 --modes 3",
)
FILE = Command(
    _add_file, _run_file, "modes.unv --container 12:z --modes 4 --scene scenes/standard.yaml --out my_beam.yaml"
)
RUN = Command(_add_run, _run_run, "out/bench --modes 3 --from 1 --to 20")
