# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim atlas`: types of motion, best heights, their stability and the cliff."""

import argparse
from pathlib import Path

from atpid_common import output
from atpid_sim.commands.simulate import number
from atpid_sim.display import counting
from atpid_sim.maps import MapError
from atpid_sim.scene import load_scene, standard_bench
from atpid_sim.studies.atlas.build import build_atlas
from atpid_sim.studies.atlas.picture import draw_atlas
from atpid_sim.studies.atlas.plan import plan_of
from atpid_sim.studies.atlas.stability_picture import draw_stability

#: Amplitudes of the standard bench [m], with 0.01 m in their middle.
_AMPLITUDES = "0.00125:0.08"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "scene", metavar="SCENE.yaml", nargs="?",
        help="the system: beam, grain radius, contact, gravity, tolerance; default: the standard bench",
    )  # fmt: skip
    files = "atlas.npz, atlas.csv, atlas.json, atlas.png, atlas_stability.png"
    parser.add_argument("--out", required=True, metavar="DIR", help=f"folder for {files}")
    parser.add_argument(
        "--amplitudes", default=_AMPLITUDES, metavar="A0:A1", help=f"support amplitudes [m]; default {_AMPLITUDES}"
    )
    parser.add_argument("--quick", action="store_true", help="a coarse grid: seconds instead of minutes")
    count = number(int, 1, 1000, "a whole number from 1 to 1000")
    parser.add_argument("--workers", type=count, default=None, metavar="K", help="threads; default: all cores")


def run(args: argparse.Namespace) -> int:
    """Make the atlas, its tables and its pictures; return 0. Raises SceneError, MapError, OutputError."""
    scene = standard_bench() if args.scene is None else load_scene(args.scene)
    plan = plan_of(*range_of(args.amplitudes), args.quick)
    folder = output.folder(Path(args.out))
    with counting("atlas, columns", len(plan.places), kept=True) as count:
        atlas = build_atlas(scene, plan, folder / "atlas.npz", count, args.workers)
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


def range_of(text: str) -> tuple[float, float]:
    """Return the ends of `A0:A1` [m]; raise MapError where it does not read so."""
    try:
        lowest, highest = (float(part) for part in text.split(":"))
    except ValueError:
        lowest = highest = 0.0
    if not 1e-9 < lowest < highest <= 1e3:
        raise MapError(f"--amplitudes: given {text}; allowed is A0:A1 with 0 < A0 < A1 [m]")
    return lowest, highest
