# SPDX-License-Identifier: Apache-2.0
"""The executable `replay_files`: writes what a replay is started with, for replay.launch.py and for other starters.

It prints the path of the parameter file of identifier_node, selector_node, recorder_node and replay_node.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_common.cli import guarded
from atpid_control.bags.replay_files import write_replay_files


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(prog="replay_files", description=__doc__)
    parser.add_argument("bag", type=Path, help="folder of the bag")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument("--rate", type=rate, default=1.0, help="speed against the recording; 0: as fast as possible")
    parser.add_argument("--record", type=Path, help="bag to make of the replay; not given: none")
    add_files(parser)

    def run() -> int:
        given = parser.parse_args(argv)
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
    parser.add_argument("--scene", type=Path, help="scene to use in place of the one kept in the bag")
    parser.add_argument("--map", type=Path, help="height map to use in place of the one kept in the bag")


def rate(text: str) -> float:
    """Return a speed against the recording [-]; raise argparse's error where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f"given {text}; allowed: 0 to 1000")
    return value


if __name__ == "__main__":
    sys.exit(main())
