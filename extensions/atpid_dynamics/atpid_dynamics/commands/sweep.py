# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid sweep`: the steady motions of a scene over heights, support amplitudes and grain masses."""

import argparse
import json

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_common.files import Document
from atpid_sim.commands.map import amplitudes_of, mass_fractions_of
from atpid_sim.commands.options import add_accuracy, add_table, add_workers, workers_of, write_table
from atpid_sim.display import counting
from atpid_sim.scene import load_scene
from atpid_sim.simulation.batch import beside

EXAMPLE = "scenes/standard.yaml --heights 0.05:0.15:101 --out sweep.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="the system and its excitation, a tone")
    heights = "N heights from H0 to H1 [m], to which the ceiling goes last"
    parser.add_argument("--heights", type=amplitudes_of, required=True, metavar="H0:H1:N", help=heights)
    parser.add_argument("--amplitudes", type=amplitudes_of, metavar="A0:A1:N", help="N support amplitudes [m]")
    fractions = "grain mass over total mass [-]"
    parser.add_argument("--mass-fractions", type=mass_fractions_of, metavar="m1,m2,...", help=fractions)
    add_accuracy(parser)
    add_workers(parser)
    add_table(parser, "write the table here, and what is done in a journal beside it")


def run(args: argparse.Namespace) -> int:
    """Find the motions and print how; return 0. Raises SceneError, OutputError, JournalError."""
    from atpid_dynamics.over_heights import ARRAYS, Way, over_heights
    from atpid_dynamics.sweep import cases

    scene = load_scene(args.scene)
    if args.out is not None:
        output.file(args.out, replace=args.force)
    scenes = cases(scene, args.mass_fractions, args.amplitudes)
    with counting("heights", len(scenes) * len(args.heights)) as count:
        heights, journal = np.array(args.heights), None if args.out is None else beside(args.out)
        done = over_heights(scenes, heights, args.fidelity, args.rtol, workers_of(args), count, journal)
    rows: list[Document] = []
    supports = [each.excitation.amplitude_points[-1][1] for each in scenes]
    for each, support, one in zip(scenes, supports, done, strict=True):
        head = {"mass_fraction": each.grain.mass_fraction, "support": support}
        for values in zip(*(getattr(one, name).tolist() for name in ARRAYS), strict=True):
            row = dict(zip(ARRAYS, values, strict=True))
            rows.append(output.finite({**head, **row, "ways": Way(row["ways"]).name.lower(), "fidelity": one.fidelity}))
    write_table(rows, args.out)
    if args.out is not None:
        beside(args.out).unlink(missing_ok=True)
    if args.json:
        print(json.dumps(rows, allow_nan=False))
        return 0
    for each, support, one in zip(scenes, supports, done, strict=True):
        print(f"grain {each.grain.mass_fraction:g}, support {support:g} m: {one.sentence}")
    return 0
