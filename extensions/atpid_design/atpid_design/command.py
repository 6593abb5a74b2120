# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid design`: a damper for a structure of one's own, and what it promises."""

import argparse
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field, ValidationError
from pydantic_core import PydanticUndefined
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

import atpid_sim
from atpid_common import output
from atpid_common.arguments import file_path, number, refuse, refuse_number, rising
from atpid_common.files import Document, FileError, read_text
from atpid_design.make import Design, design, steps_of
from atpid_design.problem import RISING, DesignError, Problem, Uncertainty, problem_of, scene_of
from atpid_sim.display import counting
from atpid_sim.fields import SceneBlock
from atpid_sim.scene.scene import explained
from atpid_sim.scene.structure import Beam, FurtherMode
from atpid_sim.scene.yaml12 import read_yaml

#: Options that are fields of `Problem`, each with what stands for its value in the help.
_OPTIONS = (
    "mass KG, frequency HZ, damping RATIO, restitution E, young-modulus PA, density KG/M3, gravity G, "
    "side-friction MU, slope RAD/M, max-mass-fraction SHARE, max-height M, target-reduction SHARE, "
    "target-efficiency SHARE, lever M, motor-speed 1/MIN, yield-strength PA, amplitudes LO:HI, "
    "excitation-frequency HZ|LO:HI"
)
EXAMPLE = "--mass 2 --frequency 15 --damping 0.02 --amplitudes 0.001:0.003 --out out/design"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    kinds: dict[str, Callable[[str], object]] = {"amplitudes": rising(1e-6, 1e3, RISING), "excitation-frequency": _band}
    blocks = "beam, further_modes and drive of a scene, or of what `atpid modes` writes"
    whole = f"{blocks}, in place of --mass, --frequency and --damping"
    parser.add_argument("--structure", type=file_path, metavar="FILE.yaml", help=whole)
    parser.add_argument("--drive", choices=("support", "force"), help="what shakes the structure; default support")
    for name, metavar in map(str.split, _OPTIONS.split(", ")):
        kind, needed = kinds.get(name, number), name == "amplitudes"
        field = Problem.model_fields[name.replace("-", "_")]
        shown = (field.description or "").replace("%", "%%")
        if not needed and field.default not in (None, PydanticUndefined):
            shown += f"; default {field.default:g}"
        parser.add_argument(f"--{name}", type=kind, metavar=metavar, required=needed, help=shown)
    usual = ", ".join(f"{name} {field.default:g}" for name, field in Uncertainty.model_fields.items())
    off = f"how far a quantity may lie from its value to either side, relative, height in m; default: {usual}"
    parser.add_argument("--uncertainty", type=_uncertainty, metavar="NAME=VALUE,...", help=off)
    parser.add_argument("--out", type=file_path, required=True, help="folder for page, numbers, scene and height map")


def run(args: argparse.Namespace) -> int:
    """Make the design and its files, print the result; return 0. Raises DesignError, NumericalFailure, OutputError."""
    problem = problem_of(**_given(args))
    output.folder(args.out)
    with counting("design", steps_of(problem)) as count:
        made = design(problem, count)
    # here, so that bad input is refused before the drawing libraries are loaded
    from atpid_design.files import write

    written = write(made, args.out)
    console = Console(width=max(Console().width, 120), highlight=False, markup=False)
    for shown in (_summary(made), _over_amplitudes(made)):
        console.print(shown)
    for line in made.warnings:
        console.print(f"warning: {line}", soft_wrap=True)
    for path in written:
        print(path)
    return 0


def _given(args: argparse.Namespace) -> Document:
    """Return the values of `Problem` that are given, by option or in the file of the structure."""
    given = {name: value for name in Problem.model_fields if (value := getattr(args, name, None)) is not None}
    own = [f"--{name}" for name in ("mass", "frequency", "damping") if name in given]
    if args.structure is None:
        if len(own) < 3:
            allowed = "--structure FILE.yaml, or all of --mass --frequency --damping"
            raise DesignError(f"structure: given {' '.join(own) or 'none'}; allowed: {allowed}")
        return given
    if own or args.drive:
        named = " ".join([*own, *(["--drive"] if args.drive else [])])
        raise DesignError(f"--structure: given beside {named}; allowed: the file alone, or the options")
    return structure_in(args.structure) | given


def _band(text: str) -> tuple[float, float]:
    """Return the frequencies of HZ or LO:HI [Hz]; `Problem` states their range."""
    with suppress(ValueError):
        low, high = map(float, (text if ":" in text else f"{text}:{text}").split(":"))
        if all(0.0 < one <= 1e6 for one in (low, high)):
            return low, high
    return refuse_number(text, "HZ or LO:HI, such as 29.4 or 28:30")


def _uncertainty(text: str) -> dict[str, float]:
    names = list(Uncertainty.model_fields)
    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        try:
            sound = name in names and name not in found
            found[name] = float(value)
        except ValueError:
            sound = False
        if not sound:
            refuse(text, f"NAME=VALUE with a decimal point, each once, separated by commas, of {', '.join(names)}")
    return found


def _summary(made: Design) -> Table:
    from atpid_design.page import headline, structure, tone, verdict
    from atpid_design.picture import mass

    drive, (low, high) = made.motor, made.heights
    closed = f"{2e3 * made.radius:.1f} mm"
    table = Table(title=headline(made), title_justify="left", show_header=False, box=SIMPLE_HEAD, pad_edge=False)
    share = f"{100 * made.mass_fraction:.3g} % of beam and grain"
    table.add_row("grain", f"{mass(made.grain_mass)}, {share}, diameter {closed}")
    table.add_row("structure", structure(made.problem))
    moves = f"the resonance moves from {made.problem.frequency:.2f} to {made.resonance:.2f} Hz, damper closed"
    table.add_row("excitation", f"{tone(made)}; {moves}")
    error = f"an error of {1e3 * drive.height_error:.2g} mm costs 2 points"
    table.add_row("heights of the ceiling", f"{1e3 * low:.1f} to {1e3 * high:.1f} mm, closed {closed}; {error}")
    speed = f"{1e3 * drive.speed:.3g} mm/s, to follow in {drive.time_constant:.3g} s"
    screw = f"screw with {1e3 * drive.lead:g} mm lead, gear {drive.gear:.3g} at {drive.motor_speed:g} 1/min"
    table.add_row("speed of the ceiling", f"{speed}; {screw}, {drive.power:.2g} W")
    lever = f"{drive.torque:.3g} N m at a lever of {1e3 * drive.lever:g} mm"
    table.add_row("largest forces", f"ceiling {drive.force:.4g} N, floor {drive.floor_force:.4g} N; {lever}")
    rate = f"{drive.impact_rate:.3g} a second, {drive.mean_force:.3g} N on average"
    table.add_row("impacts on the ceiling", f"{rate}; peak pressure {1e-6 * drive.pressure:.3g} MPa")
    table.add_row("beside a tuned mass", verdict(made.tuned_mass.rows))
    table.add_row("comes back after", comes_back(made))
    table.add_row("time", f"{made.wall_s:.1f} s")
    return table


def _over_amplitudes(made: Design) -> Table:
    """Return the promise, a column an amplitude; beneath what is expected the least and the largest."""
    from atpid_design.page import promise

    heads, rows = list(promise(made)[0]), [list(row.values()) for row in promise(made)]
    first, *lines = [
        [head, *(cell if isinstance(cell, str) else "\n".join(cell) for cell in cells)]
        for head, *cells in zip(heads, *rows, strict=True)
    ]
    table = Table(*first, box=SIMPLE_HEAD, pad_edge=False)
    for line in lines:
        table.add_row(*line)
    return table


#: Size of the file at most [bytes].
_LARGEST = 1_000_000


class Blocks(SceneBlock):
    """What is read of a scene, or of what `atpid modes` writes; the rest of it is not used."""

    model_config = ConfigDict(extra="ignore")
    beam: Beam = Field(description="the mode that matters")
    further_modes: tuple[FurtherMode, ...] = Field(default=(), description="the modes beside it")
    drive: Literal["support", "force"] = Field(default="support", description="what shakes it")


def structure_in(path: Path) -> Document:
    """Return the structure in a YAML file by the names of `Problem`. Raises DesignError and SceneError in one line."""
    try:
        given = Blocks.model_validate(read_yaml(read_text(path, _LARGEST), str(path)))
    except FileError as error:
        raise DesignError(f"--structure: {error}") from None
    except ValidationError as error:
        raise DesignError(f"--structure: {path}: {explained(error.errors(include_url=False), Blocks)}") from None
    beam, others = given.beam, {"further_modes": given.further_modes, "drive": given.drive}
    omega = math.sqrt(beam.stiffness / beam.mass)
    frequency, damping = omega / (2.0 * math.pi), beam.damping / (2.0 * beam.mass * omega)
    return {"mass": beam.mass, "frequency": frequency, "damping": damping, **others}


#: A kick [m/s].
KICK = 0.1


def comes_back(made: Design) -> str:
    """Return the share of kicks of `KICK` after which the given structure's motion comes back, where fewest do.

    At each amplitude of the design, at its height. Raises NumericalFailure.
    """
    if not hasattr(atpid_sim, "kicked"):
        return "not tried: comes with the package atpid_dynamics, which is not installed: `make setup`"
    scenes = [
        scene_of(made.problem, made.mass_fraction, one.amplitude, one.height, frequency=one.frequency)
        for one in made.points
    ]
    found = [atpid_sim.kicked(scene, KICK) for scene in scenes]
    come = [one for one in found if one.starts]
    none = f"no steady motion at {len(found) - len(come)} of {len(found)} amplitudes" if len(come) < len(found) else ""
    if not come:
        return none
    least = min(come, key=lambda one: (one.share, -one.times[2]))
    text = f"{100 * least.share:.1f} % ({100 * least.low:.1f} to {100 * least.high:.1f} %) of kicks of {KICK:g} m/s"
    late = f", 95 % within {least.times[2]:.2g} s" if least.share >= 0.95 else ""
    scale, unit = made.problem.unit
    at = f"at a {made.problem.drive} of {scale * least.drive_amplitude:.3g} {unit}"
    return "; ".join(filter(None, [f"{text} {at}{late}", none]))
