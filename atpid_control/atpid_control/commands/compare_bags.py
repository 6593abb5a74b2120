# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control compare-bags A B --out DIR`: two recorded runs overlaid, their differences in a table."""

import argparse
import math

from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.arguments import file_path, word
from atpid_control.bag_comparison.compare import CLOCK, START, Compared, Row, compare_bags
from atpid_control.bag_comparison.picture import draw
from atpid_control.commands.results import Shown, add_results, claim, give
from atpid_sim.display import working

PICTURE, NUMBERS = "bags.png", "bags.json"

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short bags/rumble --out out/two"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("first", type=file_path, metavar="A", help="folder of the first bag; of one that is cut off what is there")
    add("second", type=file_path, metavar="B", help="folder of the second bag")
    add_results(parser)
    align = f"common time 0: {START} of the samples, {CLOCK} of the hardware, or a kind of event; default: {START}"
    add("--align", type=word, default=START, metavar="BY", help=align)


def run(args: argparse.Namespace) -> int:
    """Compare, write picture and numbers, print; return 0. Raises BagError, BagComparisonError, OutputError."""
    picture, file = claim(args, PICTURE, NUMBERS)
    with working("reading both, repeating their stages by simulation, drawing"):
        found = compare_bags(args.first, args.second, args.align)
        draw(found, picture)
    notes = [*(f"note: {line}" for line in found.doubts), *(f"missing: {line}" for line in found.missing)]
    return give(args, found.to_json(), file, Shown(table(found), notes, picture))


def table(found: Compared) -> Table:
    """Return the differences as a table."""
    shown = Table(box=SIMPLE_HEAD, pad_edge=False)
    shown.add_column("")
    for name in ("first", "second", "difference", "relative"):
        shown.add_column(name, justify="right", no_wrap=True)
    for row in found.rows:
        unit = f" [{row.unit}]" if row.unit else ""
        shown.add_row(f"{row.name}{unit}", *_cells(row))
    return shown


def _cells(row: Row) -> list[str]:
    values = [f"{value:.5g}" if math.isfinite(value) else "–" for value in (row.first, row.second, row.difference)]
    return [*values, f"{100.0 * row.relative:+.2f} %" if math.isfinite(row.relative) else ""]
