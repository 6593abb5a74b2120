# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies planar`: what friction on the side wall and the tip's slope change, and the page's table."""

import argparse
import math

import numpy as np

from atpid_common.arguments import MOST_SEED, file_path, whole
from atpid_sim.display import counting
from studies.planar.heights import Best, best
from studies.planar.heights import table as heights_table
from studies.planar.measure import Compared, changes, compared, systems, table
from studies.selection_speed import into

#: Steps a period.
_STEPS = 4000
#: Systems that are run with half the step too, and those whose best heights are found.
_HALVED, _HEIGHTS = 20, 120
#: Lines of the page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies planar -->", "<!-- end of planar -->"
#: Arguments of the example in the help.
EXAMPLE = "--systems 8"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--systems", type=whole(1, 100_000), default=40, metavar="N", help="how many; default 40")
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="S", help="of the systems; default 1")
    parser.add_argument("--page", type=file_path, metavar="FILE", help="page whose table is made anew")


def run(args: argparse.Namespace) -> int:
    """Compare, print the table, write the page; return 0."""
    found, changed, heights = list[Compared](), list[float](), list[Best]()
    with counting("systems", args.systems) as count:
        for number, system in enumerate(systems(args.systems, args.seed)):
            coarse = compared(system, (args.seed, number), _STEPS)
            found += coarse
            if number < _HALVED:
                changed += changes(coarse, compared(system, (args.seed, number), 2 * _STEPS))
            if number < _HEIGHTS and system.side_gravity:
                heights.append(best(system, (args.seed, number)))
            count(number + 1)
    middle, wide = 100.0 * np.quantile(changed or [math.nan], (0.5, 0.95))
    text = (
        f"{table(found)}\n\n{args.systems} systems, seed {args.seed}. With half the step the effect changes by "
        f"{middle:.2f} points (median), {wide:.2f} (95 % of the regular motions).\n\n{heights_table(heights)}"
    )
    print(text)
    if args.page is not None:
        into(args.page, text, _BEGIN, _END)
    return 0
