# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies atlas`: types of motion, best heights, their stability and the cliff."""

import argparse

from atpid_common import output
from atpid_common.arguments import file_path, rising
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.scene import load_scene, standard_bench
from studies.atlas.build import build_atlas
from studies.atlas.picture import draw_atlas
from studies.atlas.plan import plan_of
from studies.atlas.stability_picture import draw_stability

#: Type of the ends A0:A1 of the amplitudes [m].
range_of = rising(1e-9, 1e3, "A0:A1 with 0 < A0 < A1, at most 1000 m", closed=False)
#: Amplitudes of the standard bench [m], with 0.01 m in their middle.
_AMPLITUDES = "0.00125:0.08"
#: Arguments of the example in the help.
EXAMPLE = "scenes/standard.yaml --quick --out out/atlas"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "scene", type=file_path, metavar="SCENE.yaml", nargs="?",
        help="the system: beam, grain radius, contact, gravity, tolerance; default: the standard bench",
    )  # fmt: skip
    files = "atlas.npz, atlas.csv, atlas.json, atlas.png, atlas_stability.png"
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help=f"folder for {files}")
    parser.add_argument(
        "--amplitudes", type=range_of, default=_AMPLITUDES, metavar="A0:A1",
        help=f"support amplitudes [m]; default {_AMPLITUDES}",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="a coarse grid: seconds instead of minutes")
    add_workers(parser)


def run(args: argparse.Namespace) -> int:
    """Make the atlas, its tables and its pictures; return 0. Raises SceneError, JournalError, OutputError."""
    scene = standard_bench() if args.scene is None else load_scene(args.scene)
    lowest, highest = args.amplitudes
    plan = plan_of(lowest, highest, args.quick)
    folder = output.folder(args.out)
    with counting("atlas, columns", len(plan.places), kept=True) as count:
        atlas = build_atlas(scene, plan, folder / "atlas.npz", count, workers_of(args))
    atlas.write_tables(folder)
    draw_atlas(atlas, 2.0 * scene.grain.radius, folder / "atlas.png", thesis=args.scene is None)
    draw_stability(atlas, scene, folder / "atlas_stability.png")
    summary = atlas.summary()
    cliffs = ", ".join(f"{number} {loss.lower()}" for loss, number in summary["cliffs"].items())
    print(
        f"{folder}: {summary['simulations']} simulations in {summary['columns']} columns; "
        f"{summary['stable']} of {summary['best_heights']} best heights with a stable periodic motion; "
        f"cliffs: {cliffs or 'none'}; {summary['cells_failed']} of {summary['cells']} cells could not be computed"
    )
    return 0
