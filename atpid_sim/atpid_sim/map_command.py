# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim map`: the best heights of a system, with a progress bar; goes on after a kill."""

from __future__ import annotations

import argparse
import sys

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from atpid_sim.maps import HeightMap, MapError, build_map, write_header
from atpid_sim.scene import load_scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "scene", metavar="SCENE.yaml", help="the system: beam, grain radius, contact, gravity, frequency"
    )
    parser.add_argument("--amplitudes", required=True, metavar="A0:A1:N", help="N support amplitudes from A0 to A1 [m]")
    parser.add_argument("--mass-fractions", required=True, metavar="m1,m2,...", help="grain mass over total mass [-]")
    parser.add_argument("--out", required=True, metavar="MAP.npz", help="file to write")
    parser.add_argument(
        "--header", metavar="FILE.h", help="also write a table for the motor's firmware, one mass fraction"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="compute on the Dask cluster of this scheduler (optional extra)"
    )
    parser.add_argument("--workers", type=int, default=None, metavar="K", help="threads; default: all cores")


def run(args: argparse.Namespace) -> int:
    """Make the map; return 0. Raises SceneError, MapError, NumericalFailure."""
    scene = load_scene(args.scene)
    amplitudes, fractions = amplitudes_of(args.amplitudes), mass_fractions_of(args.mass_fractions)
    if args.header and len(fractions) != 1:
        raise MapError(f"--header: given {len(fractions)} mass fractions; a firmware table holds one, so map one")
    with _bar() as bar:
        task = bar.add_task("height map", total=len(amplitudes) * len(fractions))
        made = build_map(
            scene,
            amplitudes,
            fractions,
            args.out,
            lambda done, _: bar.update(task, completed=done),
            args.workers,
            args.scheduler,
        )
    if args.header:
        write_header(made, fractions[0], args.header)
    _tell(made, args.out)
    return 0


def amplitudes_of(text: str) -> list[float]:
    """Return the amplitudes of `A0:A1:N` [m]; raise MapError where it does not read so."""
    parts = text.split(":")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
        sound = len(parts) == 3 and 0.0 < first < last and 2 <= count <= 100_000
    except (ValueError, IndexError):
        sound = False
    if not sound:
        raise MapError(f"--amplitudes: given {text}; allowed is A0:A1:N with 0 < A0 < A1 [m] and N of at least 2")
    # rounded to a nanometre, so that the same grid written another way finds its points in the journal
    return [float(a) for a in np.round(np.linspace(first, last, count), 9)]


def mass_fractions_of(text: str) -> list[float]:
    """Return the mass fractions of `m1,m2,...`, sorted; raise MapError where it does not read so."""
    try:
        fractions = sorted({float(part) for part in text.split(",")})
    except ValueError:
        fractions = []
    if not fractions or not all(0.0 < fraction < 1.0 for fraction in fractions):
        raise MapError(f"--mass-fractions: given {text}; allowed are numbers between 0 and 1, separated by commas")
    return fractions


def _bar() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(file=sys.stderr),
    )


def _tell(made: HeightMap, out: str) -> None:
    irregular = int(np.size(made.reproducible) - np.count_nonzero(made.reproducible))
    print(f"{out}: {made.heights.size} best heights, {made.heights.min():.4f} to {made.heights.max():.4f} m, ", end="")
    print(f"efficiency {100 * made.efficiencies.min():.1f} to {100 * made.efficiencies.max():.1f} %, ", end="")
    print(f"{irregular} not reproducible")
