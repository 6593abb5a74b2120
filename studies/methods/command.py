# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies methods`: methods of selection and passive dampers on the same scenes, side by side."""

import argparse
import json

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, path_to
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.simulation.batch import beside
from studies import pages
from studies.methods import page
from studies.methods.picture import draw
from studies.methods.run import Compared, compare, load_scenes, steps, to_json
from studies.methods.structures import ComparisonError

#: Arguments of the example in the help.
EXAMPLE = "scenes/thesis_4_3.yaml scenes/stiff_beam.yaml --out out/methods"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scenes", type=file_path, nargs="+", metavar="SCENE.yaml", help="the systems, and amplitudes that are held")
    add("--out", type=file_path, required=True, metavar="DIR", help="folder for methods.json and methods.png")
    add(
        "--page",
        type=path_to(".md"),
        metavar="FILE.md",
        help="write the page of the documentation, its picture in a folder `figures`",
    )
    add_workers(parser)


def run(args: argparse.Namespace) -> int:
    """Compare, print the table, write numbers, picture and page; return 0. Raises what a scene or a run raises."""
    scenes = load_scenes(args.scenes)
    if args.page is not None and tuple(scenes) != page.SCENES:
        raise ComparisonError(f"--page: given with {', '.join(scenes)}; its text is about {', '.join(page.SCENES)}")
    folder = output.folder(args.out)
    if args.page is not None:
        output.folder(pages.figures(pages.to_write(args.page)), "--page")
    results = []
    for name, scene in scenes.items():
        with counting(name, steps(scene)) as count:
            results.append(compare(scene, name, count, workers_of(args), beside(folder / f"{name}.json")))
    with output.writing(folder):
        (folder / "methods.json").write_text(json.dumps(to_json(results), indent=1, allow_nan=False), encoding="utf-8")
    for name in scenes:
        beside(folder / f"{name}.json").unlink(missing_ok=True)
    Console(width=150, highlight=False, markup=False).print(_table(results))
    print(draw(results, folder / "methods.png"))
    if args.page is not None:
        print(draw(results, pages.figures(args.page) / "methods.png"))
        with output.writing(args.page, "--page"):
            args.page.write_text(page.page_text(results, pages.link(args.page)), encoding="utf-8")
        print(args.page)
    return 0


def _table(results: list[Compared]) -> Table:
    title = "efficiency [%] over the amplitudes; in brackets the least with 5 % error of the model"
    shown = Table(*page.headings(results), box=SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left")
    for cells in page.rows(results):
        shown.add_row(*cells)
    return shown
