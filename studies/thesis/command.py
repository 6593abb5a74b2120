# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies thesis NAME|all|list`: the thesis's figures and tables, computed, beside its own numbers."""

import argparse
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, path_to, word
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.simulation.batch import Workers
from studies import pages
from studies.thesis import page
from studies.thesis.points import jobs
from studies.thesis.run import Finished, finished
from studies.thesis.study import StudyError, load, names

#: Arguments of the example in the help.
EXAMPLE = "list"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("name", type=word, metavar="NAME", help="a study; all: every one; list: their names")
    parser.add_argument("--out", type=file_path, help="folder for rows and pictures; a finished study in it is kept")
    parser.add_argument("--scenes", type=file_path, help="folder of the scenes; default: scenes")
    add_workers(parser)
    parser.add_argument(
        "--page", type=path_to(".md"), metavar="FILE.md", help="of all: write the page, pictures in a folder `figures`"
    )


def run(args: argparse.Namespace) -> int:
    """Run the studies, print what differs; return 0. Raises StudyError and what a run raises."""
    if args.name == "list":
        for name in names():
            print(f"{name:<22} {load(name).section:<10} {load(name).title}")
        return 0
    chosen = names() if args.name == "all" else [args.name]
    if args.page is not None and args.name != "all":
        raise StudyError(f"--page: given with {args.name}; the page shows all studies: give all")
    if args.out is None:
        raise StudyError("--out: none given; give a folder for rows and pictures")
    swept = {key for name in chosen for grid in load(name).sweep for key in grid}
    scenes = args.scenes or Path("scenes")
    if (args.scenes or "scene_file" in swept) and not scenes.is_dir():
        raise StudyError(f"--scenes: given {scenes}, no folder; give that of the scenes")
    output.folder(args.out)
    if args.page is not None:
        pages.to_write(args.page)
    done = [_one(name, args.out, scenes, workers_of(args)) for name in chosen]
    if args.page is not None:
        for path in page.write_page(done, args.page):
            print(path)
    return 0


def _one(name: str, folder: Path, scenes: Path, workers: Workers) -> Finished:
    with counting(name, len(jobs(load(name), scenes))) as count:
        one = finished(name, folder, scenes, count, workers)
    Console(width=150, highlight=False, markup=False).print(_table(one))
    return one


def _table(one: Finished) -> Table:
    shown = Table(box=SIMPLE_HEAD, pad_edge=False, title=f"{one.name}: {one.study.title}", title_justify="left")
    for heading in ("figure", "quantity", "ours", "thesis", "difference"):
        shown.add_column(heading)
    for row in one.rows:
        shown.add_row(*(cell.replace("**", "") for cell in page.cells(row)[:5]))
    return shown
