# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control analyse BAG --out DIR`: frequency response, spectra, decrement and orders of a bag."""

import argparse
import json
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, positive, real, word
from atpid_control.analysis.analyse import Analysis, analyse
from atpid_control.analysis.picture import draw
from atpid_control.analysis.rows import rows
from atpid_control.analysis.spectra import WINDOWS
from atpid_control.export.motions import INPUT, OUTPUT, signals_in
from atpid_sim.display import working

PICTURE, NUMBERS = "analysis.png", "analysis.json"

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/analysis"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("bag", type=file_path, metavar="BAG", help="folder of the bag; one that breaks off gives what is there")
    add("--out", type=file_path, required=True, metavar="DIR", help="folder for picture and numbers")
    add("--input", type=word, default=INPUT, metavar="CHANNEL", help=f"what excites; default: {INPUT}")
    add("--output", type=word, default=OUTPUT, metavar="CHANNEL", help=f"what answers; default: {OUTPUT}")
    add("--from", dest="begin", type=real(0.0, 1e9, "s"), metavar="S", help="begin of the part analysed [s]")
    add("--to", dest="end", type=positive("s"), metavar="S", help="its end [s]")
    add(
        "--resolution",
        type=positive("Hz"),
        metavar="HZ",
        help="distance of two lines; default: 16 segments of the part",
    )
    add(
        "--window",
        choices=WINDOWS,
        default="hann",
        help="boxcar: the excitation's period is the segment; default: hann",
    )
    output.add_force(parser)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Analyse, write picture and numbers, print; return 0. Raises BagError, ExportError, AnalysisError, OutputError."""
    output.folder(args.out)
    for name in (PICTURE, NUMBERS):
        output.file(args.out / name, replace=args.force)
    with working("reading and analysing"):
        signals, missing = signals_in(args.bag, args.input, args.output)
        given = args.begin is not None or args.end is not None
        part = signals.between(args.begin or 0.0, args.end or math.inf) if given else signals
        found = analyse(part, args.resolution, args.window, whole=given)
        draw(found, args.out / PICTURE)
    numbers = {"bag": str(args.bag), **found.to_json(), "missing": missing}
    with output.writing(args.out):
        (args.out / NUMBERS).write_text(json.dumps(numbers, indent=1, allow_nan=False), encoding="utf-8")
    if args.json:
        print(json.dumps(numbers, allow_nan=False))
        return 0
    Console(width=110, highlight=False, markup=False).print(table(found))
    for line in found.doubts:
        print(f"not to be trusted: {line}")
    for line in missing:
        print(f"missing: {line}")
    print(args.out / PICTURE)
    return 0


def table(found: Analysis) -> Table:
    """Return the results as a table."""
    shown = Table(box=SIMPLE_HEAD, pad_edge=False, show_header=False)
    for row in rows(found):
        shown.add_row(*row)
    return shown
