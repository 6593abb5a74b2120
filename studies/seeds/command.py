# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies seeds SCENE.yaml ...`: scenes through the loop with many noises, one row a stage."""

import argparse
import json
from dataclasses import asdict

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common.arguments import file_path, real, whole
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from studies.journal_option import add_journal
from studies.seeds.measure import SeedRun, configured, run_all

#: Arguments of the example in the help.
EXAMPLE = "scenes/thesis_4_3.yaml --seeds 10"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scenes", type=file_path, nargs="+", metavar="SCENE", help="scenes whose ceiling a controller moves")
    add("--seeds", type=whole(1, 100_000), default=50, help="runs of each scene, each with a noise of its own")
    add(
        "--decibels",
        type=real(-100.0, 300.0, "dB"),
        help="signal to noise at the smallest amplitude [dB]; default: the scene's noise",
    )
    add("--margin", type=real(0.0, 100.0), help="standard deviations the height is safe for; default: selector.yaml")
    add_workers(parser, "processes")
    add_journal(parser)
    add("--json", action="store_true", help="print every run as JSON instead of the table")


def run(args: argparse.Namespace) -> int:
    """Run all scenes with all seeds; print one row a stage."""
    parameters = configured()
    if args.margin is not None:
        parameters["selector_node"]["margin"] = args.margin
    seeds = range(1, args.seeds + 1)
    with counting("runs", len(args.scenes) * args.seeds) as count:
        done = run_all(args.scenes, seeds, parameters, args.decibels, count, workers_of(args), args.journal)
    if args.json:
        print(json.dumps([asdict(one) for one in done]))
    else:
        Console(width=110, highlight=False).print(table(done))
    return 0


def table(done: list[SeedRun]) -> Table:
    """Return one row a stage: the worst and the mean of all seeds."""
    result = Table(box=SIMPLE_HEAD, pad_edge=False, title="over all seeds", title_justify="left")
    result.add_column("scene")
    figures = ("efficiency [%]\nmean", "\nworst", "longest\nrumble [s]", "step\nbacks", "drifts")
    for name in ("A [m]", "seeds", "height [m]", *figures):
        result.add_column(name, justify="right", no_wrap=True)
    for scene in dict.fromkeys(one.scene for one in done):
        runs = [one for one in done if one.scene == scene]
        counts = str(sum(one.step_backs for one in runs)), str(sum(one.drifts for one in runs))
        for row, stages in enumerate(zip(*(one.stages for one in runs), strict=True)):
            heights, gains = [s.height for s in stages], [100.0 * s.efficiency for s in stages]
            result.add_row(
                scene if row == 0 else "", f"{stages[0].excitation_amplitude:g}", str(len(stages)),
                f"{min(heights):.4f}-{max(heights):.4f}", f"{np.mean(gains):.2f}", f"{min(gains):.2f}",
                f"{max(s.rumble for s in stages):.2f}", *(counts if row == 0 else ("", "")),
            )  # fmt: skip
    return result
