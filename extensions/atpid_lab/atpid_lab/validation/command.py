# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag validate RECORDING`: a scene simulated with the measured support, and compared."""

import argparse
from pathlib import Path

import numpy as np
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_control.commands.results import Shown, add_part, add_results, claim, give, two_columns
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import open_run
from atpid_lab.validation.compare import Agreement, compare, driven_scene
from atpid_lab.validation.measured import Measured, read_measured, scene_of
from atpid_lab.validation.picture import panels
from atpid_sim.display import working
from atpid_sim.scene import load_scene
from atpid_sim.simulation.integration import FIDELITIES

SERIES, SCENE, PICTURE, NUMBERS = "support.csv", "scene.yaml", "agreement.png", "agreement.json"
#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/agreement"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add(
        "recording",
        type=file_path,
        metavar="RECORDING",
        help="a bag, of one that is cut off what is there, or a .csv table with time, support and beam",
    )
    add(
        "--scene",
        type=file_path,
        metavar="SCENE.yaml",
        help="beam, grain and contact; default: the scene kept in the bag",
    )
    add("--height", type=positive("m"), metavar="H", help="a fixed ceiling [m]; default: as recorded")
    add_part(parser, "begin of the part compared")
    add("--fidelity", default="auto", choices=["auto", *FIDELITIES], help="fidelity level; default: auto")
    add_results(parser, "scene, series, picture and numbers")


def run(args: argparse.Namespace) -> int:
    """Simulate, compare, print; return 0.

    Raises ValidationError, SceneError, BagError, NumericalFailure, OutputError.
    """
    args.recording = bag_of(args.recording)
    series, kept, picture, file = claim(args, SERIES, SCENE, PICTURE, NUMBERS)
    recorded = open_run(args.recording)
    measured = read_measured(recorded, args.begin, args.end)
    scene = scene_of(recorded) if args.scene is None else load_scene(args.scene)
    _write_series(measured, series)
    driven = driven_scene(scene, measured, series.resolve(), args.height)
    with output.writing(kept):
        kept.write_text(driven.to_yaml(), encoding="utf-8")
    with working("simulating"):
        found = compare(driven, measured, args.fidelity)
    end = measured.begin + measured.duration
    faults = recorded.faults(measured.begin, end)
    numbers = {
        **found.to_json(), "origin": measured.origin, "begin": measured.begin, "end": end,
        "without_gap": measured.chosen, "missing": list(measured.missing), "faults": faults,
    }  # fmt: skip
    notes = [f"not to be trusted: {line}" for line in faults]
    title = f"{args.recording} beside its simulation"
    return give(args, numbers, file, Shown(title, _table(found, measured), notes, picture, panels(found)))


def _write_series(measured: Measured, path: Path) -> None:
    times = np.arange(len(measured.support)) / measured.rate
    with output.writing(path):
        np.savetxt(path, np.column_stack([times, measured.support]), fmt="%.12g", delimiter=",",
                   header=f"time,{measured.drive.channel}", comments="")  # fmt: skip


def _table(found: Agreement, measured: Measured) -> Table:
    numbers = found.to_json()
    irregular = "" if found.reproducible else " (irregular: repeated simulations do not agree)"
    span = f"{measured.begin:.4g} to {measured.begin + measured.duration:.4g} s"
    rows = [
        ("origin of the samples", measured.origin),
        ("part", f"{span}, the longest without a gap" if measured.chosen else span),
        ("relative RMSE of the amplitudes (Eq. 3.46)", f"{100.0 * found.rmse:.3g} %"),
        ("largest of a period", f"{100.0 * numbers['largest_error']:+.3g} % at {numbers['largest_error_at']:.3g} s"),
        ("difference of the displacements, root mean square", f"{100.0 * found.displacement_error:.3g} %"),
        ("periods compared", f"{numbers['compared_periods']} of {numbers['periods']}"),
        ("left out at the begin, grain's place unknown", f"{found.left_out:.3g} s"),
        ("lag of the measured beam, taken off", f"{1e3 * found.lag:.3g} ms"),
        ("fidelity", found.fidelity + irregular),
    ]
    return two_columns(rows)
