# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control analyse BAG --out DIR`: frequency response, spectra, decrement and orders of a bag."""

import argparse
import math

from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.arguments import file_path, positive, real, word
from atpid_control.analysis.analyse import Analysis, analyse
from atpid_control.analysis.picture import draw
from atpid_control.analysis.rows import rows
from atpid_control.analysis.spectra import WINDOWS
from atpid_control.commands.results import Shown, add_results, claim, give
from atpid_control.export.motions import INPUT, OUTPUT, signals_in
from atpid_sim.display import working

PICTURE, NUMBERS = "analysis.png", "analysis.json"

#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/analysis"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("bag", type=file_path, metavar="BAG", help="folder of the bag; of one that is cut off what is there")
    add_results(parser)
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


def run(args: argparse.Namespace) -> int:
    """Analyse, write picture and numbers, print; return 0. Raises BagError, ExportError, AnalysisError, OutputError."""
    picture, file = claim(args, PICTURE, NUMBERS)
    with working("reading and analysing"):
        given = args.begin is not None or args.end is not None
        ends = (args.begin or 0.0, args.end or math.inf) if given else (-math.inf, math.inf)
        recorded = signals_in(args.bag, args.input, args.output, *ends)
        part = recorded.signals.between(*ends) if given else recorded.signals
        found = analyse(part, args.resolution, args.window, whole=given)
        draw(found, picture)
    numbers = {"bag": str(args.bag), **found.to_json(), "missing": recorded.missing, "faults": recorded.faults}
    notes = [f"not to be trusted: {line}" for line in (*found.doubts, *recorded.faults)]
    notes += [f"missing: {line}" for line in recorded.missing]
    return give(args, numbers, file, Shown(table(found), notes, picture))


def table(found: Analysis) -> Table:
    """Return the results as a table."""
    shown = Table(box=SIMPLE_HEAD, pad_edge=False, show_header=False)
    for row in rows(found):
        shown.add_row(*row)
    return shown
