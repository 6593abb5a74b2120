# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag report|export|traces BAG`: a bag as a page, as files of other programs, as plotting tools take it."""

import argparse
import math

from atpid_common import output
from atpid_common.arguments import file_path, graph_name, path_to, real
from atpid_common.cli import Command
from atpid_control.commands.results import add_bag, add_part, print_missing
from atpid_control.runs.parts import bag_of
from atpid_control.runs.read import open_bag
from atpid_control.views.export.write import FORMATS, export
from atpid_sim.display import working

_BAG = "bags/thesis_4_3_short"


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag(parser)
    folder = "folder for report.html and the pictures: new, empty, or an earlier one"
    parser.add_argument("--out", type=file_path, required=True, help=folder)


def _report(args: argparse.Namespace) -> int:
    """Make the report; return 0. Raises BagError, ReportError."""
    from atpid_control.views.report.make import check_folder, report  # here, since it loads slowly

    bag = bag_of(args.bag)
    check_folder(args.out)
    with working("reading the bag, repeating its stages by simulation, drawing"):
        made = report(bag, args.out)
    print(made.headline)
    print_missing(made.missing)
    print(made.page)
    return 0


def _export_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag(parser)
    add = parser.add_argument
    add("--format", choices=tuple(FORMATS), required=True, help="csv and parquet: a file a topic, named after --out")
    add("--out", type=file_path, required=True, metavar="FILE", help="the file to write")
    add("--topic", type=graph_name, action="append", default=[], metavar="TOPIC", help="only this topic; repeatable")
    add_part(parser)
    output.add_force(parser)


def _export(args: argparse.Namespace) -> int:
    """Export and print what was written and what is missing; return 0. Raises BagError, OutputError."""
    with working(f"exporting to {args.format}"):
        done = export(bag_of(args.bag), args.format, args.out, args.topic, args.begin, args.end, replace=args.force)
    for path, what in done.files:
        print(f"{path}: {what}")
    print_missing(done.missing)
    if done.left_out:
        print(f"not evenly sampled, so not in this format: {', '.join(done.left_out)}")
    return 0


def _traces_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag(parser)
    add = parser.add_argument
    add("--out", type=path_to(".mcap"), required=True, metavar="FILE.mcap", help="file to write")
    rate = "samples a second at most, every n-th of the record; default: all"
    add("--rate", type=real(0.1, 1e7, "Hz"), default=math.inf, metavar="HZ", help=rate)
    output.add_force(parser)


def _traces(args: argparse.Namespace) -> int:
    """Write the file, print what is in it; return 0. Raises BagError, SceneError, OutputError."""
    from atpid_control.views.traces import PREFIX, write_traces  # here, since it loads slowly

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


REPORT = Command(_report_arguments, _report, f"{_BAG} --out out/report")
EXPORT = Command(_export_arguments, _export, f"{_BAG} --format csv --out out/run.csv")
TRACES = Command(_traces_arguments, _traces, f"{_BAG} --out out/traces.mcap")
