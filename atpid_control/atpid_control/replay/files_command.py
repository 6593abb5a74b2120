# SPDX-License-Identifier: Apache-2.0
"""The executable `replay_files`: writes what a replay is started with, for replay.launch.py and for other starters.

It prints the path of the parameter file of identifier_node, selector_node, recorder_node and replay_node.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_common.cli import guarded
from atpid_control.replay.arguments import add_files, rate
from atpid_control.replay.files import write_replay_files


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


if __name__ == "__main__":
    sys.exit(main())
