# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control export BAG --format FORMAT --out FILE`: a bag for programs without ROS."""

import argparse
import math

from atpid_common import output
from atpid_common.arguments import file_path, graph_name, positive, real
from atpid_control.export.write import FORMATS, export
from atpid_sim.display import working

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --format csv --out out/run.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("bag", type=file_path, metavar="BAG", help="folder of the bag; of one that is cut off what is there")
    add("--format", choices=tuple(FORMATS), required=True, help="csv and parquet: a file a topic, named after --out")
    add("--out", type=file_path, required=True, metavar="FILE", help="the file to write")
    add("--topic", type=graph_name, action="append", default=[], metavar="TOPIC", help="only this topic; repeatable")
    add("--from", dest="begin", type=real(0.0, 1e9, "s"), metavar="S", help="begin of the part exported [s]")
    add("--to", dest="end", type=positive("s"), default=math.inf, metavar="S", help="its end [s]")
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Export and print what was written and what is missing; return 0. Raises BagError, ExportError, OutputError."""
    begin = -math.inf if args.begin is None else args.begin
    with working(f"exporting to {args.format}"):
        done = export(args.bag, args.format, args.out, args.topic, begin, args.end, replace=args.force)
    for path, what in done.files:
        print(f"{path}: {what}")
    for line in done.missing:
        print(f"missing: {line}")
    if done.left_out:
        print(f"not evenly sampled, so not in this format: {', '.join(done.left_out)}")
    return 0
