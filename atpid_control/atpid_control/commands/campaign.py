# SPDX-License-Identifier: Apache-2.0
"""`atpid campaign FILE.yaml --out FOLDER`: a stand measured over many points, which goes on where it was ended."""

import argparse
import json
import math
import os
import shutil
import sys
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_common.cli import Command
from atpid_control.campaign.folder import CampaignFolder
from atpid_control.campaign.plan import Campaign, Point, campaign_in, points_of, read_campaign
from atpid_control.campaign.run import Done, Pause, run_campaign, summary
from atpid_control.campaign.stands import SimulatedStand, Stand
from atpid_control.stand.processes import stoppable
from atpid_sim.display import counting, working
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
    columns = (
        TextColumn("points"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    print(
        f"pause after a point, or go on: kill -USR1 {os.getpid()}; Ctrl-C ends, the same command goes on",
        file=sys.stderr,
    )
    with folder.open(plan), stoppable(), pause.by_signal():
        with Bar(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task("points", total=points, left="")

            def progress(done: int, left: float) -> None:
                bar.update(task, completed=done, left="" if math.isnan(left) else f"{_clock(left)} left")

            try:
                done = run_campaign(
                    campaign, scene, folder, lambda point: _open(campaign, scene, point, folder.path), progress, pause
                )
            except KeyboardInterrupt:
                raise KeyboardInterrupt(
                    f"stopped: {_line(summary(campaign, scene, folder))}; the same command goes on"
                ) from None
        _conclude(campaign, scene, folder, done)
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


def _conclude(campaign: Campaign, scene: Scene, folder: CampaignFolder, done: Done) -> None:
    from atpid_control.campaign.page import write_page

    print(_line(done))
    for text in done.skipped:
        print(f"skipped: {text}")
    with counting("simulating every point beside", done.measured) as count:
        page = write_page(campaign, scene, folder, progress=count)
    print(f"{page}; a model of this stand: atpid calibrate campaign {folder.path} --out DIR")


def _model_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=file_path, metavar="FOLDER", help="of a campaign, with points of the damper closed")
    add("--out", type=file_path, required=True, metavar="DIR", help="folder for model.yaml, agreement.json and map.npz")
    mass = "the moving mass with the lightest grain [kg]; default: by two grains, else the scene's"
    add("--moving-mass", type=positive("kg"), metavar="KG", help=mass)
    add("--map", action="store_true", help="make the height map of this stand as well, which takes minutes")


def _model(args: argparse.Namespace) -> int:
    """Find the model, compare it with every point, print both; return 0. Raises AtpidError."""
    from atpid_control.campaign.model import model_of, written
    from atpid_control.campaign.page import AGREE, compared
    from atpid_control.selection.map_cache import map_for

    folder, out = CampaignFolder(args.folder.resolve()), output.folder(args.out)
    campaign, scene = campaign_in(folder.plan(), folder.path)
    with working("reading the points"):
        model = model_of(campaign, scene, folder, args.moving_mass)
    with output.writing(out):
        path = written(model, scene, out)
    found = model.scene(scene)
    print(path.read_text(encoding="utf-8").partition("beam:")[0].rstrip())
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title="simulation against measurement", title_justify="left")
    for name in ("point", "measured [mm]", "scene given [mm]", "apart [σ]", "model found [mm]", "apart [σ]"):
        table.add_column(name, justify="left" if name == "point" else "right")
    with counting("simulating every point with both", 2 * len(folder.records())) as count:
        pairs = list(
            zip(compared(campaign, scene, folder, progress=count), compared(campaign, found, folder), strict=True)
        )
    for given, own in pairs:
        cells = (given.record["beam_amplitude"], given.record["simulated_amplitude"], own.record["simulated_amplitude"])
        shown = [f"{1e3 * value:.4g}" for value in cells]
        table.add_row(given.point.text, *shown[:2], f"{given.apart:+.1f}", shown[2], f"{own.apart:+.1f}")
    Console(width=110, highlight=False).print(table)
    agree = [sum(abs(one.apart) <= AGREE for one in column) for column in zip(*pairs, strict=True)]
    print(
        f"within {AGREE:g} standard deviations: {agree[0]} of {len(pairs)} by the scene given, {agree[1]} by the model"
    )
    with output.writing(out):
        rows = [own.record | {"apart": own.apart} for _, own in pairs]
        (out / "agreement.json").write_text(json.dumps({"uncertainty": model.uncertainty, "points": rows}, indent=1))
    uncertainty = ",".join(f"{name}={max(value, 1e-4):.2g}" for name, value in model.uncertainty.items())
    print(f"design: atpid design --structure {path} --uncertainty {uncertainty} ...")
    print(f"margin: stiffness_uncertainty of selector_node, {model.uncertainty['frequency'] * 2.0:.2g}")
    if args.map:
        made = map_for(found.with_(ceiling=found.to_mapping()["ceiling"] | {"controller": "lookup"}))
        assert made is not None
        shutil.copy(made, out / "map.npz")
        print(f"map: {out / 'map.npz'}")
    return 0


MODEL = Command(_model_arguments, _model, "out/campaign --out out/model")
