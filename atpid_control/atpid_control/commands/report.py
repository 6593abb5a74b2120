# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag report BAG`: a bag as a page with pictures."""

import argparse

from atpid_common.arguments import file_path
from atpid_control.commands.results import add_bag, print_missing
from atpid_control.runs.formats import bag_of
from atpid_sim.display import working

EXAMPLE = "bags/thesis_4_3_short --out out/report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_bag(parser)
    folder = "folder for report.html and the pictures: new, empty, or an earlier one"
    parser.add_argument("--out", type=file_path, required=True, help=folder)


def run(args: argparse.Namespace) -> int:
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
