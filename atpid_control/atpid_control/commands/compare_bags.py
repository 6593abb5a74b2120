# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control compare-bags A B --out DIR`: two recorded runs overlaid, their differences in a table."""

import argparse
import json
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, word
from atpid_control.bag_comparison.compare import CLOCK, START, Compared, Row, compare_bags
from atpid_control.bag_comparison.picture import draw
from atpid_sim.display import working

PICTURE, NUMBERS = "bags.png", "bags.json"

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short bags/rumble --out out/two"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("first", type=file_path, metavar="A", help="folder of the first bag")
    add("second", type=file_path, metavar="B", help="folder of the second bag")
    add("--out", type=file_path, required=True, metavar="DIR", help="folder for picture and numbers")
    align = f"common time 0: {START} of the samples, {CLOCK} of the hardware, or a kind of event; default: {START}"
    add("--align", type=word, default=START, metavar="BY", help=align)
    output.add_force(parser)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Compare, write picture and numbers, print; return 0. Raises BagError, BagComparisonError, OutputError."""
    output.folder(args.out)
    for name in (PICTURE, NUMBERS):
        output.file(args.out / name, replace=args.force)
    with working("reading both, repeating their stages by simulation, drawing"):
        found = compare_bags(args.first, args.second, args.align)
        draw(found, args.out / PICTURE)
    numbers = found.to_json()
    with output.writing(args.out):
        (args.out / NUMBERS).write_text(json.dumps(numbers, indent=1, allow_nan=False), encoding="utf-8")
    if args.json:
        print(json.dumps(numbers, allow_nan=False))
        return 0
    Console(width=110, highlight=False, markup=False).print(table(found))
    for line in found.doubts:
        print(f"note: {line}")
    print(args.out / PICTURE)
    return 0


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
