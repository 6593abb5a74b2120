# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid basin`: the share of kicks, or of initial states, that come to the promised motion, over heights."""

import argparse
import json
from dataclasses import asdict
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

from atpid_common import output
from atpid_common.arguments import MOST_SEED, file_path, positive, real, whole
from atpid_common.files import Document
from atpid_sim.commands.map import amplitudes_of
from atpid_sim.commands.options import add_table, add_workers, workers_of, write_table
from atpid_sim.display import counting
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene
from atpid_sim.simulation.batch import Batch

if TYPE_CHECKING:
    from atpid_dynamics.basin import Basin, Starts

#: Size of a kick where neither that nor a box is given [m/s].
_KICK = 0.1
EXAMPLE = "scenes/standard.yaml --heights 0.1:0.16:4 --kick 0.1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scene", type=file_path, metavar="SCENE.yaml", help="the system and its excitation, a tone")
    heights = parser.add_mutually_exclusive_group()
    heights.add_argument("--height", type=positive("m"), metavar="H", help="of the ceiling [m]; default: the scene's")
    heights.add_argument("--heights", type=amplitudes_of, metavar="H0:H1:N", help="N heights from H0 to H1 [m]")
    drives = "N amplitudes of the drive [m or N]"
    parser.add_argument("--amplitudes", type=amplitudes_of, metavar="A0:A1:N", help=drives)
    starts = parser.add_mutually_exclusive_group()
    help_kick = "start from the promised motion at any phase, kicked by V [m/s]; default: 0.1"
    starts.add_argument("--kick", type=real(0.0, 1e3, "m/s", above=True), metavar="V", help=help_kick)
    help_box = "start anywhere within S times the motion's size, the grain anywhere between floor and ceiling"
    starts.add_argument("--box", type=real(0.0, 1e3, above=True), metavar="S", help=help_box)
    help_error = "half-width of the 95 %% interval, for which the number of starts is chosen; default: 0.02"
    parser.add_argument("--error", type=real(1e-3, 0.5), default=0.02, metavar="E", help=help_error)
    parser.add_argument("--starts", type=whole(1, 1_000_000), metavar="N", help="so many in place of --error")
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="S", help="of the starts; default: 1")
    add_workers(parser)
    add_table(parser)


def run(args: argparse.Namespace) -> int:
    """Compute the shares and print them; return 0. Raises SceneError, OutputError, NumericalFailure."""
    from atpid_dynamics.basin import Starts

    scene = load_scene(args.scene)
    if not scene.excitation.is_tone:
        raise SceneError("excitation: given one that is no tone; allowed for the share that comes to a motion: a tone")
    if args.out is not None:
        output.file(args.out, replace=args.force)
    starts = Starts(args.kick or _KICK) if args.box is None else Starts(None, args.box)
    jobs = list(product(args.heights or (args.height,), args.amplitudes or (None,)))
    work = partial(_at, scene, starts, args.error, args.starts, args.seed)
    with counting("basins", len(jobs)) as count:
        found = Batch(work, jobs).run(workers_of(args), count)
    rows: list[Document] = [output.finite(asdict(one)) for one in found]
    write_table(rows, args.out)
    if args.json:
        print(json.dumps(rows, allow_nan=False))
    else:
        for one in found:
            drive = f"{scene.drive} {one.drive_amplitude:.4g} {'N' if scene.drive == 'force' else 'm'}"
            print(f"{one.height:.5g} m, {drive}: {one.sentence(starts.kick, starts.box)}")
    return 0


def _at(
    scene: Scene, starts: "Starts", error: float, count: int | None, seed: int, at: tuple[float | None, float | None]
) -> "Basin":
    from atpid_dynamics.basin import basin

    height, amplitude = at
    changed = scene if height is None else scene.with_(height=height)
    changed = changed if amplitude is None else changed.with_(amplitude=amplitude)
    try:
        return basin(changed, starts, error, count, seed)
    except NumericalFailure as error_there:
        raise NumericalFailure(f"at a height of {changed.ceiling.heights[-1][1]:g} m: {error_there}") from None
