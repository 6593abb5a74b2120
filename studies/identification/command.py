# SPDX-License-Identifier: Apache-2.0
"""`python -m studies identification`: how often the identifier's 95 % intervals hold the truth."""

import argparse

from atpid_common.arguments import whole
from atpid_sim.display import counting
from studies.identification.coverage import CASES, table

#: Arguments of the example in the help.
EXAMPLE = "--signals 200 --seed 1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--signals", type=whole(1, 100_000), default=200, help="random tones of each kind")
    parser.add_argument("--seed", type=whole(0, 1_000_000), default=1, help="of the random numbers")


def run(args: argparse.Namespace) -> int:
    """Print the table of docs/identification.md."""
    with counting("kinds", len(CASES)) as count:
        print("\n".join(table(args.signals, args.seed, count)))
    return 0
