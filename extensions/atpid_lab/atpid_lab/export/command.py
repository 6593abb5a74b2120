# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag export BAG`: a bag as files of other programs."""

import argparse

from atpid_common import output
from atpid_common.arguments import file_path, graph_name
from atpid_control.commands.results import add_bag, add_part, print_missing
from atpid_control.runs.formats import bag_of
from atpid_lab.export.write import export, writers
from atpid_sim.display import working

EXAMPLE = "bags/thesis_4_3_short --format csv --out out/run.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_bag(parser)
    add = parser.add_argument
    add("--format", choices=tuple(writers()), required=True, help="csv and parquet: a file a topic, named after --out")
    add("--out", type=file_path, required=True, metavar="FILE", help="the file to write")
    add("--topic", type=graph_name, action="append", default=[], metavar="TOPIC", help="only this topic; repeatable")
    add_part(parser)
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Export and print what was written and what is missing; return 0. Raises BagError, OutputError."""
    with working(f"exporting to {args.format}"):
        done = export(bag_of(args.bag), args.format, args.out, args.topic, args.begin, args.end, replace=args.force)
    for path, what in done.files:
        print(f"{path}: {what}")
    print_missing(done.missing)
    if done.left_out:
        print(f"not evenly sampled, so not in this format: {', '.join(done.left_out)}")
    return 0
