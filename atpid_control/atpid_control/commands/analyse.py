# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag analyse BAG --out DIR`: frequency response, spectra, decrement and orders; `atpid bag report`: a page."""

import argparse
import math

from atpid_common.arguments import file_path, positive, word
from atpid_common.cli import Command
from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.rows import panels, rows
from atpid_control.analysis.signals import integrated, signals_of
from atpid_control.analysis.spectra import WINDOWS
from atpid_control.commands import results
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import BEAM, open_run
from atpid_sim.display import working

PICTURE, NUMBERS = "analysis.png", "analysis.json"

EXAMPLE = "bags/thesis_4_3_short --out out/analysis"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    results.add_bag(parser)
    results.add_results(parser)
    add("--input", type=word, metavar="CHANNEL", help="what excites; default: support_displacement or drive_force")
    add("--output", type=word, default=BEAM, metavar="CHANNEL", help=f"what answers; default: {BEAM}")
    results.add_part(parser, "begin of the part analysed")
    integrate = "accelerations as displacements, integrated above this corner; their drift is printed"
    add("--integrate", type=positive("Hz"), metavar="HZ", help=integrate)
    resolution = "distance of two lines; default: 16 segments of the part"
    add("--resolution", type=positive("Hz"), metavar="HZ", help=resolution)
    window = "boxcar: the excitation's period is the segment; local: it passes once; default: local or hann, by it"
    add("--window", choices=WINDOWS, default="", help=window)


def run(args: argparse.Namespace) -> int:
    """Analyse, write picture and numbers, print; return 0. Raises BagError, AnalysisError, OutputError."""
    args.bag = bag_of(args.bag)
    picture, file = results.claim(args, PICTURE, NUMBERS)
    with working("reading and analysing"):
        given = (args.begin, args.end) != (-math.inf, math.inf)
        ends = (max(args.begin, 0.0), args.end) if given else (-math.inf, math.inf)
        run = open_run(args.bag, begin=ends[0], end=ends[1])
        signals, missing = signals_of(run, args.input or "", args.output)
        part = signals.between(*ends) if given else signals
        drifts: list[str] = []
        if args.integrate:
            part, drifts = integrated(part, args.integrate)
        found = analyse(part, args.resolution, args.window, whole=given)
    faults = run.faults(*ends)
    numbers = {"bag": str(args.bag), **found.to_json(), "integrated": drifts, "missing": missing, "faults": faults}
    notes = [*drifts, *(f"not to be trusted: {line}" for line in (*found.doubts, *faults))]
    shown = results.Shown(f"Analysis of {args.bag}", results.two_columns(rows(found)), notes, picture, panels(found))
    return results.give(args, numbers, file, shown)


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    results.add_bag(parser)
    folder = "folder for report.html and the pictures: new, empty, or an earlier one"
    parser.add_argument("--out", type=file_path, required=True, help=folder)


def _report(args: argparse.Namespace) -> int:
    """Make the report; return 0. Raises BagError, ReportError."""
    # here, since they load slowly
    from atpid_control.views.report.page import check_folder, write_report
    from atpid_control.views.report.view import headline, view_of

    bag = bag_of(args.bag)
    check_folder(args.out)
    with working("reading the bag, repeating its stages by simulation, drawing"):
        view = view_of(bag)
        page = write_report(view, args.out)
    print(headline(view))
    results.print_missing(view.run.missing)
    print(page)
    return 0


REPORT = Command(_report_arguments, _report, "bags/thesis_4_3_short --out out/report")
