# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid replay BAG --out DIR`, which replay.launch.py starts as well."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from atpid_control.commands.results import print_missing
from atpid_control.runs.formats import bag_of
from atpid_control.runs.playback import compare, load_playback
from atpid_control.runs.read import Bag
from atpid_control.runs.run import open_run
from atpid_control.stand import outdir
from atpid_control.stand.domain import own_domain
from atpid_control.stand.launching.options import add_replay as add_arguments
from atpid_control.stand.processes import stoppable
from atpid_control.stand.replay_files import IDENTIFIER, PLAYED, RECORDER, REPLAY, SELECTOR, write_replay_files
from atpid_control.stand.running import RosOptions, commands_of, run_realtime, shown

__all__ = ["EXAMPLE", "add_arguments", "run"]

EXAMPLE = "bags/thesis_4_3_short --out out/again"


def run(args: argparse.Namespace) -> int:
    """Replay, print how many estimates and commands agree; return 0. Raises BagError and BenchError."""
    bag, out = bag_of(args.bag.resolve()), args.out.resolve()
    playback = load_playback(bag, PLAYED)  # refused here, before an earlier replay is moved or a node started
    with outdir.of_run(out, bag):
        files = write_replay_files(
            bag, out / "kept", rate=args.rate, record=out / "bag", scene=args.scene, height_map=args.map
        )
        for note in (*playback.notes, *files.notes):
            print(note, file=sys.stderr)
        ros = RosOptions(_namespace_of(playback.bag), args.log_level or "")
        commands = commands_of(files.parameters, (REPLAY, IDENTIFIER, SELECTOR, RECORDER), ros)
        with own_domain(args.domain), stoppable(), shown(playback.seconds, bag.name) as progress:
            run_realtime(commands, out / "log", progress, ros, source=REPLAY.name)
        return _conclude(bag, out)


def _namespace_of(bag: Bag) -> str:
    """Return the namespace the graph of the bag ran in; empty: none."""
    suffix = "/excitation"
    topics = [topic for topic in bag.topics_of("Excitation") if topic.endswith(suffix)]
    return topics[0].removesuffix(suffix) if topics else ""


def _conclude(recorded: Path, out: Path) -> int:
    replayed = open_run(out / "bag")
    found = compare(open_run(recorded), replayed)
    summary = {"bag": str(recorded), "topics": [asdict(agreement) for agreement in found]}
    (out / "replay.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    for agreement in found:
        print(agreement)
    print_missing(replayed.missing)
    print(f"bag {out / 'bag'}")
    return 0
