# SPDX-License-Identifier: Apache-2.0
"""`atpid modes`: the modes of a structure as a scene has them, from its dimensions or from a file of modes."""

import argparse
import json
import math
import re
from typing import Any

from atpid_common import output
from atpid_common.arguments import file_path, path_to, positive, real, refuse, whole
from atpid_common.cli import Command
from atpid_control.analysis.modes import cantilever, universal_file
from atpid_control.analysis.modes.structure import Chosen, ModesError, Structure, choose, merged
from atpid_control.analysis.modes.universal_file import Place
from atpid_sim.contact.materials import MATERIALS
from atpid_sim.scene import load_scene
from atpid_sim.scene.yaml12 import write_yaml
from atpid_sim.simulation.simulate import finite

_AXES = "xyz"


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
    _add_modes(parser, cantilever.MOST_MODES, required=True)
    where = "a force at X from the clamp drives the beam, in place of its base [m]"
    add("--force-at", type=positive("m"), metavar="X", help=where)


def _add_file(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("modes_file", type=file_path, metavar="MODES.unv", help="universal file with data sets 55, in SI or with 164")
    container = "node of the container and direction of its motion, such as 12:z or 12:-y"
    add("--container", type=_place, required=True, metavar="NODE:DIRECTION", help=container)
    base = "direction in which the base moves; default: the container's"
    driven = parser.add_mutually_exclusive_group()
    driven.add_argument("--base", type=_direction, metavar="DIRECTION", help=base)
    where = "a force there drives the structure, in place of its base"
    driven.add_argument("--force-at", type=_place, metavar="NODE:DIRECTION", help=where)
    _add_modes(parser, cantilever.MOST_MODES, required=False)


def _add_modes(parser: argparse.ArgumentParser, most: int, *, required: bool) -> None:
    add = parser.add_argument
    every = "" if required else "; default: all that move the container"
    add("--modes", type=whole(1, most), required=required, metavar="N", help=f"how many, from the lowest{every}")
    ratio = "damping over critical damping, one for all modes or one a mode [-]"
    add("--damping-ratio", type=real(0.0, 1.0), nargs="+", default=[], metavar="R", help=ratio)
    add("--scene", type=file_path, metavar="SCENE.yaml", help="give this scene with the modes in place of its own")
    add("--out", type=path_to(".yaml", ".yml"), metavar="FILE.yaml", help="write the blocks, or the scene, here")
    output.add_force(parser)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def _direction(text: str) -> Place:
    """Return a direction such as z or -z, at no node."""
    if found := re.fullmatch(r"([+-]?)([xyzXYZ])", text):
        return Place(0, _AXES.index(found[2].lower()), -1.0 if found[1] == "-" else 1.0)
    return refuse(text, "a direction: x, y or z, perhaps with a sign before it")


def _place(text: str) -> Place:
    """Return the node and the direction of NODE:DIRECTION."""
    node, _, direction = text.partition(":")
    if re.fullmatch(r"[0-9]{1,10}", node):
        return _direction(direction)._replace(node=int(node))
    return refuse(text, "NODE:DIRECTION, such as 12:z")


def _run_cantilever(args: argparse.Namespace) -> int:
    """Compute the modes and print the blocks; return 0. Raises ModesError, SceneError, OutputError."""
    if (args.material is None) == (args.modulus is None) or (args.modulus is None) != (args.density is None):
        raise ModesError("--material, --modulus, --density: allowed: --material, or --modulus and --density")
    solid = MATERIALS.get(args.material)
    modulus, density = (solid.young_modulus, solid.density) if solid else (args.modulus, args.density)
    section = (args.length, args.width, args.thickness)
    beam = cantilever.Cantilever(*section, modulus, density, args.tip_mass, args.tip_inertia)
    return _give(args, cantilever.modes_of(beam, args.modes, args.force_at))


def _run_file(args: argparse.Namespace) -> int:
    """Read the modes and print the blocks; return 0. Raises ModesError, FileError, SceneError, OutputError."""
    base = args.base or args.container
    return _give(args, universal_file.modes_of(args.modes_file, args.container, base, args.force_at))


def _give(args: argparse.Namespace, structure: Structure) -> int:
    forced = args.force_at is not None
    chosen = choose(structure, args.modes or len(structure.modes), args.damping_ratio, forced)
    given = chosen.blocks
    if args.scene is not None:
        given = merged(load_scene(args.scene), given, str(args.scene)).to_mapping()
    text = "".join(f"# {line}\n" for line in _lines(chosen, forced)) + write_yaml(given)
    if args.out is not None:
        output.file(args.out, replace=args.force)
        with output.writing(args.out):
            args.out.write_text(text, encoding="utf-8")
    print(json.dumps(_plain(chosen)) if args.json else text, end="\n" if args.json else "")
    return 0


def _plain(chosen: Chosen) -> dict[str, Any]:
    following = chosen.next_mode
    plain: dict[str, Any] = finite({
        "modes": [mode._asdict() | {"stiffness": mode.stiffness} for mode in chosen.modes],
        "left_of_base": chosen.left_of_base, "left_of_compliance": chosen.left_of_compliance,
        "next_mode": None if following is None else following._asdict(), "amplitude_factor": chosen.amplitude_factor,
        "impulse_mass": chosen.impulse_mass,         "notes": list(chosen.notes), "blocks": chosen.blocks,
    })  # fmt: skip
    return plain


def _lines(chosen: Chosen, forced: bool) -> list[str]:
    """Return what the numbers are, a line each."""
    lines = ["Made by `atpid modes`; a mode's mass is what an impulse at the container meets, without the grain"]
    for number, mode in enumerate(chosen.modes, 1):
        drive = f"shape where the force acts {mode.force:.4g}" if forced else f"of the base's motion {mode.base:.4g}"
        slope = "" if math.isnan(mode.slope) else f", slope {mode.slope:.4g} rad/m"
        lines.append(f"mode {number}: {mode.frequency:.5g} Hz, {mode.mass:.4g} kg, {drive}{slope}")
    if forced:
        lines.append(f"a force of amplitude F has {chosen.amplitude_factor:.5g} F in the scene, mode 1's part of it")
    elif len(chosen.modes) > 1:
        lines.append(f"modes left out have {chosen.left_of_base:.2g} of the base's motion, added to the last mode")
    lines += [
        f"left out at the container: {100 * chosen.left_of_compliance:.3g} % of the static compliance",
        f"an impulse there meets {chosen.impulse_mass:.4g} kg, all these modes together",
    ]
    if chosen.next_mode is not None:
        lines.append(f"next mode: {chosen.next_mode.frequency:.5g} Hz, {chosen.next_mode.mass:.4g} kg")
    return [*lines, *chosen.notes]


CANTILEVER = Command(
    _add_cantilever, _run_cantilever,
    "--length 0.4 --width 0.04 --thickness 0.008 --modulus 5.345e9 --density 2431 --tip-mass 0.25 "
    "--damping-ratio 0.024 --modes 3",
)  # fmt: skip
FILE = Command(
    _add_file, _run_file, "modes.unv --container 12:z --modes 4 --scene scenes/standard.yaml --out my_beam.yaml"
)
