# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid campaign FILE.yaml --out FOLDER`: a stand measured over many points, which goes on where it was ended."""

import argparse
import json
import os
import shutil
import sys
from functools import partial
from itertools import chain
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_campaign.campaign.folder import CampaignFolder
from atpid_campaign.campaign.plan import Campaign, Point, campaign_in, points_of, read_campaign
from atpid_campaign.campaign.run import Done, pause_by_signal, run_campaign, summary
from atpid_campaign.campaign.stands import SimulatedStand, Stand
from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_common.cli import Command
from atpid_common.waiting import to_stderr
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.processes import stoppable
from atpid_sim.display import counting, working
from atpid_sim.scene import Scene

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
    from atpid_campaign.campaign.page import write_page  # it loads slowly: a file that cannot be is refused before

    for line in scene.warnings():
        print(f"warning: {line}", file=sys.stderr)
    folder = CampaignFolder(args.out.resolve())
    plan = {"campaign": campaign.model_dump(mode="json", exclude={"scene"}), "scene": scene.to_mapping()}
    to_stderr(f"pause after a point, or go on: kill -USR1 {os.getpid()}; Ctrl-C ends, the same command goes on")
    with folder.open(plan), stoppable(), pause_by_signal() as paused:
        with counting("points", len(points_of(campaign, scene))) as progress:
            try:
                opened = partial(_open, campaign, scene, folder.path)
                done = run_campaign(campaign, scene, folder, opened, progress, paused)
            except KeyboardInterrupt:
                reached = _line(summary(campaign, scene, folder))
                raise KeyboardInterrupt(f"stopped: {reached}; the same command goes on") from None
        print(_line(done))
        for text in done.skipped:
            print(f"skipped: {text}")
        with counting("simulating every point beside", done.measured) as count:
            page = write_page(campaign, scene, folder, count)
        print(f"{page}; a model of this stand: atpid calibrate campaign {folder.path} --out DIR")
    return 0


def _open(campaign: Campaign, scene: Scene, folder: Path, point: Point) -> Stand:
    if campaign.stand == "simulated":
        return SimulatedStand(campaign, scene)
    from atpid_campaign.campaign.graph import GraphStand

    return GraphStand(campaign, scene, point, folder)


def _line(done: Done) -> str:
    return (
        f"{done.measured} of {done.points} points measured, {len(done.skipped)} skipped, "
        f"{done.attempts_bad} bad attempts kept in bad/"
    )


def _model_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=file_path, metavar="FOLDER", help="of a campaign, with points of the damper closed")
    add("--out", type=file_path, required=True, metavar="DIR", help="folder for model.yaml, agreement.json and map.npz")
    mass = "the moving mass with the lightest grain [kg]; default: by two grains, else the scene's"
    add("--moving-mass", type=positive("kg"), metavar="KG", help=mass)
    add("--map", action="store_true", help="make the height map of this stand as well, which takes minutes")


def _model(args: argparse.Namespace) -> int:
    """Find the model, compare it with every point, print both; return 0. Raises AtpidError."""
    from atpid_campaign.campaign.model import model_of, written  # here, since they load slowly
    from atpid_campaign.campaign.page import AGREE, agreeing, compared

    folder, out = CampaignFolder(args.folder.resolve()), output.folder(args.out)
    campaign, scene = campaign_in(folder.plan(), folder.path)
    folder.check()
    with working("reading the points"):
        model = model_of(campaign, scene, folder, args.moving_mass)
    with output.writing(out):
        path = written(model, scene, out)
    found = model.scene(scene)
    print(path.read_text(encoding="utf-8").partition("beam:")[0].rstrip())
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title="simulation against measurement", title_justify="left")
    for name in ("point", "measured [mm]", "scene given [mm]", "apart [σ]", "model found [mm]", "apart [σ]"):
        table.add_column(name, justify="left" if name == "point" else "right")
    with counting("simulating every point", len(folder.records())) as count:
        given = compared(campaign, scene, folder, count)
    with counting("and with the model found", len(given)) as count:
        own = compared(campaign, found, folder, count)
    for before, after in zip(given, own, strict=True):
        texts = ((f"{1e3 * row['simulated_amplitude']:.4g}", f"{row['apart']:+.1f}") for row in (before, after))
        table.add_row(before["point"], f"{1e3 * before['beam_amplitude']:.4g}", *chain.from_iterable(texts))
    Console(width=110, highlight=False).print(table)
    agree = f"{agreeing(given)} of {len(given)} by the scene given, {agreeing(own)} by the model"
    print(f"within {AGREE:g} standard deviations: {agree}")
    with output.writing(out):
        kept = output.finite({"uncertainty": model.uncertainty, "points": own})
        (out / "agreement.json").write_text(json.dumps(kept, indent=1))
    uncertainty = ",".join(f"{name}={max(value, 1e-4):.2g}" for name, value in model.uncertainty.items())
    print(f"design: atpid design --structure {path} --uncertainty {uncertainty} ...")
    print(f"margin: stiffness_uncertainty of selector_node, {model.uncertainty['frequency'] * 2.0:.2g}")
    if args.map:
        ceiling = found.to_mapping()["ceiling"] | {"controller": "lookup"}
        ceiling.pop("map", None)  # of the scene given
        made = map_for(found.with_(ceiling=ceiling))
        assert made is not None
        with output.writing(out):
            shutil.copy(made, out / "map.npz")
        print(f"map: {out / 'map.npz'}")
    return 0


MODEL = Command(_model_arguments, _model, "out/campaign --out out/model")
