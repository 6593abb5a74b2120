# SPDX-License-Identifier: Apache-2.0
"""`atpid campaign FILE.yaml --out FOLDER`: a stand measured over many points, which goes on where it was ended."""

import argparse
import math
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from atpid_common.arguments import file_path
from atpid_control.campaign.folder import CampaignFolder
from atpid_control.campaign.plan import Campaign, Point, points_of, read_campaign
from atpid_control.campaign.run import Done, Pause, run_campaign, summary
from atpid_control.campaign.stands import SimulatedStand, Stand
from atpid_control.stand.processes import stoppable
from atpid_sim.scene import Scene

#: Arguments of the example in the help.
EXAMPLE = "campaign.yaml --out out/campaign"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("campaign", type=file_path, metavar="FILE.yaml", help="what is measured, and on which stand (docs/campaign.md)")
    folder = "folder of the points; where the same campaign is in it, the points that are missing are measured"
    add("--out", type=file_path, required=True, metavar="FOLDER", help=folder)


def run(args: argparse.Namespace) -> int:
    """Measure what is missing; return 0. Raises AtpidError, KeyboardInterrupt with how far it has come."""
    campaign, scene = read_campaign(args.campaign)
    for line in scene.warnings():
        print(f"warning: {line}", file=sys.stderr)
    folder, pause = CampaignFolder(args.out.resolve()), Pause()
    plan = {"campaign": campaign.model_dump(mode="json", exclude={"scene"}), "scene": scene.to_mapping()}
    points = len(points_of(campaign, scene))
    console = Console(stderr=True)
    columns = (TextColumn("points"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
    print(f"pause after a point, or go on: kill -USR1 {os.getpid()}; Ctrl-C ends, the same command goes on", file=sys.stderr)
    with folder.open(plan), stoppable(), pause.by_signal():
        with Bar(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task("points", total=points, left="")

            def progress(done: int, left: float) -> None:
                bar.update(task, completed=done, left="" if math.isnan(left) else f"{_clock(left)} left")

            try:
                done = run_campaign(campaign, scene, folder, lambda point: _open(campaign, scene, point, folder.path), progress, pause)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(f"stopped: {_line(summary(campaign, scene, folder))}; the same command goes on") from None
        _conclude(folder, done)
    return 0


def _open(campaign: Campaign, scene: Scene, point: Point, folder: Path) -> Stand:
    if campaign.stand == "simulated":
        return SimulatedStand(campaign, scene)
    from atpid_control.campaign.graph import GraphStand

    return GraphStand(campaign, scene, point, folder)


def _clock(seconds: float) -> str:
    minutes = math.ceil(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def _line(done: Done) -> str:
    return (
        f"{done.measured} of {done.points} points measured, {len(done.skipped)} skipped, "
        f"{done.attempts_bad} bad attempts kept in bad/"
    )


def _conclude(folder: CampaignFolder, done: Done) -> None:
    print(_line(done))
    for text in done.skipped:
        print(f"skipped: {text}")
    print(folder.path)
