# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag traces BAG`: a bag as plotting tools take it."""

import argparse
import math

from atpid_common import output
from atpid_common.arguments import path_to, real
from atpid_control.commands.results import add_bag, print_missing
from atpid_control.runs.formats import bag_of
from atpid_control.runs.read import open_bag
from atpid_sim.display import working

EXAMPLE = "bags/thesis_4_3_short --out out/traces.mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_bag(parser)
    add = parser.add_argument
    add("--out", type=path_to(".mcap"), required=True, metavar="FILE.mcap", help="file to write")
    rate = "samples a second at most, every n-th of the record; default: all"
    add("--rate", type=real(0.1, 1e7, "Hz"), default=math.inf, metavar="HZ", help=rate)
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Write the file, print what is in it; return 0. Raises BagError, SceneError, OutputError."""
    from atpid_lab.traces.file import write_traces  # here, since they load slowly
    from atpid_lab.traces.records import PREFIX

    path = bag_of(args.bag)
    file = output.file(args.out, replace=args.force)
    with working("reading the bag, writing its traces"):
        bag = open_bag(path, torn_ok=True)
        written = write_traces(bag, file, args.rate)
    for topic, count in sorted(written.messages.items()):
        if topic.startswith(PREFIX):
            print(f"{count:8d}  {topic}")
    if written.left_out:
        print(f"{written.left_out} messages of the bag cannot be used and have no traces")
    print_missing(bag.missing)
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB; layouts for it: docs/foxglove")
    return 0
