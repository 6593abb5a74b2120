# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control report BAG --out DIR`."""

import argparse

from atpid_common.arguments import file_path
from atpid_control.report.make import check_folder, report
from atpid_sim.display import working

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("bag", type=file_path, help="folder of the bag; of one that is cut off what is there")
    folder = "folder for report.html and the pictures: new, empty, or an earlier one"
    parser.add_argument("--out", type=file_path, required=True, help=folder)


def run(args: argparse.Namespace) -> int:
    """Make the report; return 0. Raises BagError, ReportError."""
    check_folder(args.out)
    with working("reading the bag, repeating its stages by simulation, drawing"):
        made = report(args.bag, args.out)
    print(made.headline)
    for line in made.missing:
        print(f"missing: {line}")
    print(made.page)
    return 0
