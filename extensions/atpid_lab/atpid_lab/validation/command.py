# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag validate RECORDING`: a scene simulated with the measured support, and compared."""

import argparse
from functools import partial
from typing import Any

import numpy as np
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_control.commands.results import Shown, add_part, add_results, claim, give, two_columns
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import open_run
from atpid_lab.validation.compare import Agreement, Measured, compare, driven_scene, read_measured, scene_of
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, Panels
from atpid_sim.scene import load_scene
from atpid_sim.simulation.integration import FIDELITIES

SERIES, SCENE, PICTURE, NUMBERS = "support.csv", "scene.yaml", "agreement.png", "agreement.json"
#: Arguments of the example in the help.
EXAMPLE = "bags/thesis_4_3_short --out out/agreement"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    recording = "a bag, of one that is cut off what is there, or a .csv table with time, support and beam"
    add("recording", type=file_path, metavar="RECORDING", help=recording)
    scene = "beam, grain and contact; default: the scene kept in the bag"
    add("--scene", type=file_path, metavar="SCENE.yaml", help=scene)
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
    times = np.arange(len(measured.support)) / measured.rate
    with output.writing(series):
        np.savetxt(series, np.column_stack([times, measured.support]), fmt="%.12g", delimiter=",",
                   header=f"time,{measured.drive.channel}", comments="")  # fmt: skip
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


#: Periods shown close up, at the end.
_CLOSE_UP = 6


def panels(found: Agreement) -> Panels:
    """Return the panels of a comparison."""
    return [[partial(drawer, found=found)] for drawer in (_whole, _difference, _amplitudes, _ceiling, _last)]


def _whole(ax: Any, found: Agreement) -> None:
    _motions(ax, found, found.time[0])
    ax.set(title="Beam displacement from rest")


def _difference(ax: Any, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * (found.measured - found.simulated), LIGHT.accent, linewidth=0.7)
    _over_time(ax, found, "Measured less simulated")


def _amplitudes(ax: Any, found: Agreement) -> None:
    ax.plot(found.period_time, 1e3 * found.measured_amplitude, LIGHT.given_text, marker=".", label="measured")
    ax.plot(found.period_time, 1e3 * found.simulated_amplitude, LIGHT.own, linewidth=1.2, label="simulated")
    _over_time(ax, found, f"Amplitude of each period; relative RMSE {100.0 * found.rmse:.2g} %")
    ax.set_ylim(0.0, None)


def _ceiling(ax: Any, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * found.ceiling, LIGHT.own, linewidth=1.4)
    _over_time(ax, found, "Ceiling height")
    ax.set_ylim(0.0, None)


def _last(ax: Any, found: Agreement) -> None:
    period = float(np.diff(found.period_time)[0]) if len(found.period_time) > 1 else np.inf
    _motions(ax, found, max(found.time[0], found.time[-1] - _CLOSE_UP * period))
    ax.set(title=f"The last {_CLOSE_UP} periods")


def _motions(ax: Any, found: Agreement, begin: float) -> None:
    shown = found.time >= begin
    ax.plot(found.time[shown], 1e3 * found.measured[shown], LIGHT.given_text, linewidth=2.4, label="measured")
    ax.plot(found.time[shown], 1e3 * found.simulated[shown], LIGHT.own, linewidth=0.8, label="simulated")
    ax.set(xlim=(begin, found.time[-1]), ylabel="mm", xlabel="time [s]")


def _over_time(ax: Any, found: Agreement, title: str) -> None:
    ax.set(xlim=(found.time[0], found.time[-1]), xlabel="time [s]", ylabel="mm", title=title)
