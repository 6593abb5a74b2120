# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag compare A B --out DIR`: two recorded runs overlaid, their differences in a table."""

import argparse
import math

from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.arguments import file_path, word
from atpid_control.commands.results import Shown, add_results, claim, give
from atpid_control.runs.formats import bag_of
from atpid_lab.comparison.compare import CLOCK, START, Compared, Row, compare_bags
from atpid_lab.comparison.picture import panels
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
    bags = bag_of(args.first), bag_of(args.second)
    picture, file = claim(args, PICTURE, NUMBERS)
    with working("reading both, repeating their stages by simulation"):
        found = compare_bags(*bags, args.align)
    notes = [f"note: {line}" for line in found.doubts]
    first, second = (placed.label for placed in found.runs)
    title = f"{first} (first) beside {second} (second), aligned by {found.aligned_by}"
    return give(args, found.to_json(), file, Shown(title, table(found), notes, picture, panels(found)))


def table(found: Compared) -> Table:
    """Return the differences as a table, lengths in mm; ±: half the spread of single runs of an irregular motion."""
    shown = Table(box=SIMPLE_HEAD, pad_edge=False)
    shown.add_column("quantity")
    for name in ("first", "second", "difference", "relative"):
        shown.add_column(name, justify="right", no_wrap=True)
    shown.add_row("origin of the samples", *(placed.signals.origin for placed in found.runs))
    for row in found.rows:
        scale, unit = (1e3, "mm") if row.unit == "m" else (1.0, row.unit)
        shown.add_row(f"{row.name}{unit and f' [{unit}]'}", *_cells(row, scale))
    return shown


def _cells(row: Row, scale: float) -> list[str]:
    values = zip((row.first, row.second, row.difference), (*row.spreads, math.hypot(*row.spreads)), strict=True)
    relative = f"{100.0 * row.relative:+.2f} %" if math.isfinite(row.relative) else ""
    return [*(_value(scale * value, scale * spread) for value, spread in values), relative]


def _value(value: float, spread: float) -> str:
    if not math.isfinite(value):
        return "–"
    if not spread:
        return f"{value:.5g}"
    digits = max(0, 1 - math.floor(math.log10(spread)))  # two of the spread
    return f"{value:.{digits}f} ± {spread:.{digits}f}"
