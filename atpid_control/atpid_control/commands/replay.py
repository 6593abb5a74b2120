# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control replay BAG --out DIR`: what replay.launch.py does, without `ros2`, and compared."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import file_path, real, whole
from atpid_common.cli import Parser, guarded
from atpid_control.bags import check_new
from atpid_control.bags.playback import compare, load_playback
from atpid_control.bags.read import Bag, open_bag
from atpid_control.bags.replay_files import IDENTIFIER, PLAYED, RECORDER, REPLAY, SELECTOR, write_replay_files
from atpid_control.bench import outdir
from atpid_control.bench.running import run_realtime, shown
from atpid_control.graph.domain import MOST, own_domain
from atpid_control.graph.processes import stoppable

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/again"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("bag", type=file_path, help="folder of the bag")
    add("--out", type=file_path, required=True, help="folder for the bag of the replay; earlier ones are kept")
    add("--rate", type=real(0.0, 1000.0), default=0.0, help="speed against the recording; 0: as fast as possible")
    add_files(parser)
    add("--domain", type=whole(0, MOST), help="ROS domain to use; default: a free one")


def run(args: argparse.Namespace) -> int:
    """Replay, print how many estimates and commands agree; return 0. Raises BagError and BenchError."""
    bag, out = args.bag.resolve(), args.out.resolve()
    playback = load_playback(bag, PLAYED)  # refused here, before an earlier replay is moved or a node started
    with outdir.of_run(out, bag):
        files = write_replay_files(
            bag, out / "kept", rate=args.rate, record=out / "bag", scene=args.scene, height_map=args.map
        )
        for note in files.notes:
            print(note, file=sys.stderr)
        namespace = namespace_of(playback.bag)
        # in the order of stopping
        remap = ["-r", f"__ns:={namespace}"] if namespace else []
        ros = ["--ros-args", "--params-file", str(files.parameters), *remap]
        commands = [(part.name, [str(part.executable), *ros]) for part in (REPLAY, IDENTIFIER, SELECTOR, RECORDER)]
        with own_domain(args.domain), stoppable(), shown(playback.seconds, bag.name) as progress:
            run_realtime(commands, out / "log", progress, source=REPLAY.name, namespace=namespace)
        return _conclude(playback.bag, out)


def namespace_of(bag: Bag) -> str:
    """Return the namespace the graph of the bag ran in; empty: none."""
    suffix = "/excitation"
    topics = [topic for topic in bag.topics_of("Excitation") if topic.endswith(suffix)]
    return topics[0].removesuffix(suffix) if topics else ""


def _conclude(recorded: Bag, out: Path) -> int:
    found = compare(recorded, open_bag(out / "bag"))
    summary = {"bag": str(recorded.path), "topics": [asdict(agreement) for agreement in found]}
    (out / "replay.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    for agreement in found:
        print(agreement)
    print(f"bag {out / 'bag'}")
    return 0


#: Of the executable `replay_files`.
HELP = "Write what a replay is started with, for replay.launch.py and for other starters; print the parameter file."


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable `replay_files`; return its exit status."""
    parser = Parser(prog="replay_files", description=HELP)
    parser.add_argument("bag", type=file_path, help="folder of the bag")
    parser.add_argument("--out", type=file_path, required=True, help="folder for the files")
    parser.add_argument(
        "--rate", type=real(0.0, 1000.0), default=1.0, help="speed against the recording; 0: as fast as possible"
    )
    parser.add_argument("--record", type=file_path, help="bag to make of the replay; not given: none")
    add_files(parser)

    def run() -> int:
        given = parser.parse_args(argv)
        if given.record is not None:
            check_new(given.record)
            output.folder(given.record.parent, "--record")
        files = write_replay_files(
            given.bag, given.out, rate=given.rate, record=given.record, scene=given.scene, height_map=given.map
        )
        for note in files.notes:
            print(note, file=sys.stderr)
        print(files.parameters)
        return 0

    return guarded(run)


def add_files(parser: argparse.ArgumentParser) -> None:
    """Declare the files that may take the place of those kept in the bag."""
    parser.add_argument("--scene", type=file_path, help="scene to use in place of the one kept in the bag")
    parser.add_argument("--map", type=file_path, help="height map to use in place of the one kept in the bag")
