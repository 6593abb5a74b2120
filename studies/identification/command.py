# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies identification`: how often the identifier's 95 % intervals hold the truth."""

import argparse

from atpid_common.arguments import file_path, whole
from atpid_sim.display import counting
from studies.identification.coverage import CASES, table
from studies.identification.structures import structures
from studies.selection_speed import into

#: Lines of the page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies identification -->", "<!-- end -->"
#: Arguments of the example in the help.
EXAMPLE = "--signals 200 --seed 1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--signals", type=whole(1, 100_000), default=200, help="random tones of each kind")
    parser.add_argument("--seed", type=whole(0, 1_000_000), default=1, help="of the random numbers")
    parser.add_argument(
        "--structures", type=whole(1, 10_000), metavar="N", help="beside N random structures of several modes instead"
    )
    parser.add_argument("--page", type=file_path, metavar="FILE", help="page whose table is made anew")


def run(args: argparse.Namespace) -> int:
    """Print the table of docs/research/identification.md, and put it into a page."""
    if args.structures is not None:
        with counting("structures", args.structures) as count:
            print("\n".join(structures(args.structures, args.seed, count)))
        return 0
    with counting("kinds", len(CASES)) as count:
        text = "\n".join(table(args.signals, args.seed, count))
    print(text)
    if args.page is not None:
        into(args.page, text, _BEGIN, _END)
    return 0
