# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid map`: the best heights of a system, with a progress bar; goes on after a kill."""

import argparse
import sys
from pathlib import Path

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path, path_to, refuse_number
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.maps import HeightMap, MapError, build_map, write_header
from atpid_sim.maps.response import HIGHEST_RATIO, LOWEST_RATIO
from atpid_sim.scene import Scene, load_scene
from atpid_sim.scene.plausibility import LARGEST_AMPLITUDE, Quantity

#: Arguments of the example in the help.
EXAMPLE = "scenes/standard.yaml --amplitudes 0.005:0.03:5 --mass-fractions 0.1 --out out/map.npz"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    system = "the system: beam, grain radius, contact, gravity, frequency"
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help=system)
    amplitudes = "N support amplitudes from A0 to A1 [m]"
    parser.add_argument("--amplitudes", type=amplitudes_of, required=True, metavar="A0:A1:N", help=amplitudes)
    fractions = "grain mass over total mass [-]"
    parser.add_argument("--mass-fractions", type=mass_fractions_of, required=True, metavar="m1,m2,...", help=fractions)
    ratios = "N frequencies over the natural one, 0.5 to 2 [-]; default: the scene's frequency alone"
    parser.add_argument("--frequency-ratios", type=_ratios_of, metavar="R0:R1:N", help=ratios)
    parser.add_argument("--out", type=path_to(".npz"), required=True, metavar="MAP.npz", help="file to write")
    header = "also write a table for the motor's firmware, one mass fraction"
    parser.add_argument("--header", type=path_to(".h"), metavar="FILE.h", help=header)
    add_workers(parser)
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Make the map; return 0. Raises SceneError, MapError, NumericalFailure."""
    scene = load_scene(args.scene)
    amplitudes, fractions, ratios = args.amplitudes, args.mass_fractions, args.frequency_ratios
    if args.header and len(fractions) != 1:
        raise MapError(f"--header: given {len(fractions)} mass fractions; a firmware table holds one, so map one")
    if args.header and ratios:
        raise MapError("--header: given with --frequency-ratios; a firmware table holds one frequency; leave one out")
    output.file(args.out, replace=args.force)
    if args.header:
        output.file(args.header, "--header", replace=args.force)
    _warn(scene, amplitudes, fractions)
    with counting("height map", len(amplitudes) * len(fractions) * len(ratios or (1.0,)), kept=True) as count:
        made = build_map(scene, amplitudes, fractions, args.out, lambda done, _: count(done), workers_of(args), ratios)
    if args.header:
        write_header(made, fractions[0], args.header)
    _print_summary(made, args.out)
    return 0


def amplitudes_of(text: str) -> list[float]:
    """Return the amplitudes of `A0:A1:N` [m]; raise argparse's error where it does not read so."""
    found = _grid(text, 0.0, 1e3)
    return found or refuse_number(text, "A0:A1:N with 0 < A0 < A1, at most 1000 m, and N from 2 to 100000")


def _ratios_of(text: str) -> list[float]:
    """Return the frequency ratios of `R0:R1:N` [-]; raise argparse's error where it does not read so."""
    found = _grid(text, LOWEST_RATIO * (1.0 - 1e-12), HIGHEST_RATIO)
    allowed = f"R0:R1:N with {LOWEST_RATIO:g} <= R0 < R1 <= {HIGHEST_RATIO:g}, and N from 2 to 100000"
    return found or refuse_number(text, allowed)


def _grid(text: str, above: float, most: float) -> list[float]:
    """Return the numbers of `first:last:count`, evenly spaced; none where it does not read so."""
    parts = text.split(":")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
        sound = len(parts) == 3 and above < first < last <= most and 2 <= count <= 100_000
    except (ValueError, IndexError):
        sound = False
    # rounded to a nanometre, so that the same grid written another way finds its points in the journal
    return [float(value) for value in np.round(np.linspace(first, last, count), 9)] if sound else []


def mass_fractions_of(text: str) -> list[float]:
    """Return the mass fractions of `m1,m2,...`, sorted; raise argparse's error where it does not read so."""
    try:
        fractions = sorted({float(part) for part in text.split(",")})
    except ValueError:
        fractions = []
    if not fractions or not all(0.0 < fraction < 1.0 for fraction in fractions):
        refuse_number(text, "numbers between 0 and 1, separated by commas")
    return fractions


def _warn(scene: Scene, amplitudes: list[float], fractions: list[float]) -> None:
    """Print what is unusual in the map's own grid and system; the scene's ceiling and excitation do not count."""
    grid = Quantity("--amplitudes, largest", amplitudes[-1], 0.0, LARGEST_AMPLITUDE, "m", "lengths are in metres")
    system = (scene.with_(mass_fraction=fraction).warnings() for fraction in fractions)
    lines = [line for lines in system for line in lines if line.startswith(("beam", "grain", "contact", "gravity"))]
    for line in dict.fromkeys([*lines, *filter(None, [grid.warning()])]):
        print(f"warning: {line}", file=sys.stderr)


def _print_summary(made: HeightMap, out: Path) -> None:
    computed = made.heights.size - len(made.failures)
    irregular = computed - int(np.count_nonzero(made.reproducible))
    closed = int(np.count_nonzero(made.efficiencies == 0.0))
    of_no_use = f", {closed} of no use: closed" if closed else ""
    print(
        f"{out}: {computed} best heights, {np.nanmin(made.heights):.4f} to {np.nanmax(made.heights):.4f} m, "
        f"efficiency {100 * np.nanmin(made.efficiencies):.1f} to {100 * np.nanmax(made.efficiencies):.1f} %, "
        f"reduction {100 * np.nanmin(made.reductions):.1f} to {100 * np.nanmax(made.reductions):.1f} %, "
        f"{irregular} not reproducible{of_no_use}"
    )
    if made.failures:
        first = made.failures[0]
        print(
            f"{len(made.failures)} of {made.heights.size} points could not be computed (NaN in the map); the first: "
            f"{first.amplitude:g} m, mass fraction {first.mass_fraction:g}: {first.reason}"
        )
