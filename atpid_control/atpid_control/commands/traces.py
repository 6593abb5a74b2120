# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control traces BAG --out FILE.mcap`: a bag as Foxglove and PlotJuggler plot it."""

import argparse
import math

from atpid_common import output
from atpid_common.arguments import file_path, path_to, real
from atpid_control.bags import open_bag
from atpid_control.traces import write_traces
from atpid_control.traces.records import PREFIX
from atpid_sim.display import working

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/traces.mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("bag", type=file_path, help="folder of the bag; of one that is cut off what is there")
    add("--out", type=path_to(".mcap"), required=True, metavar="FILE.mcap", help="file to write")
    rate = "samples a second at most, every n-th of the record; default: all"
    add("--rate", type=real(0.1, 1e7, "Hz"), default=math.inf, metavar="HZ", help=rate)
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Write the file, print what is in it; return 0. Raises BagError, SceneError, OutputError."""
    file = output.file(args.out, replace=args.force)
    with working("reading the bag, writing its traces"):
        bag = open_bag(args.bag, torn_ok=True)
        written = write_traces(bag, file, args.rate)
    for topic, count in sorted(written.messages.items()):
        if topic.startswith(PREFIX):
            print(f"{count:8d}  {topic}")
    if written.left_out:
        print(f"{written.left_out} messages of the bag cannot be used and have no traces")
    for line in bag.missing:
        print(f"missing: {line}")
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB; layouts for it: docs/foxglove")
    return 0
