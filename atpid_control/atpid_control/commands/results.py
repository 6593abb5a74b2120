# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the commands on recordings have in common: the bag, a part of it, a folder for results, what is printed."""

import argparse
import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, path_to, positive, real
from atpid_common.files import Document
from atpid_control.views.static_page import document, drawn, facts, table, warnings
from atpid_sim.figure_style import Panels, save_panels

_WIDTH = 110


class Shown(NamedTuple):
    """What a command shows of its results, on the screen and as a page."""

    title: str
    table: Table
    notes: Sequence[str]  # a line each
    picture: Path
    panels: Panels  # of the picture, and of the page


def add_results(parser: argparse.ArgumentParser, what: str = "picture and numbers") -> None:
    """Declare `--out`, `--force` and `--json`."""
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help=f"folder for {what}")
    output.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Declare the bag to read."""
    folder = "folder of the bag; of one that is cut off what is there"
    parser.add_argument("bag", type=file_path, metavar="BAG", help=folder)


def add_part(parser: argparse.ArgumentParser, begin: str = "begin of the part") -> None:
    """Declare `--from` and `--to` [s], by default minus and plus infinity."""
    add = parser.add_argument
    add("--from", dest="begin", type=real(0.0, 1e9, "s"), default=-math.inf, metavar="S", help=f"{begin} [s]")
    add("--to", dest="end", type=positive("s"), default=math.inf, metavar="S", help="its end [s]")


def add_block(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare `--out` of a file for blocks of a scene, `--force` and `--json`."""
    parser.add_argument("--out", type=path_to(".yaml", ".yml"), metavar="FILE.yaml", help=f"write {what} here")
    output.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def give_block(args: argparse.Namespace, text: str, numbers: Document, shown: str) -> int:
    """Write the text of blocks where `--out` is given; print the numbers with `--json`, else what is shown; return 0.

    Raises OutputError.
    """
    if args.out is not None:
        with output.writing(args.out):
            args.out.write_text(text, encoding="utf-8")
    print(json.dumps(numbers) if args.json else shown)
    return 0


def two_columns(rows: Iterable[tuple[str, str]]) -> Table:
    """Return (what, its value) as a table without a head."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_header=False)
    for row in rows:
        table.add_row(*row)
    return table


def claim(args: argparse.Namespace, *names: str) -> list[Path]:
    """Return the files of these names in `--out`, before the work. Raises OutputError: they cannot be written.

    The page of a picture is claimed with it. A folder with an earlier result and nothing else needs no `--force`.
    """
    every = [*names, *(f"{name[:-4]}.html" for name in names if name.endswith(".png"))]
    replace = args.force or {item.name for item in output.folder(args.out).iterdir()} == set(every)
    return [output.file(args.out / name, replace=replace) for name in every][: len(names)]


def give(args: argparse.Namespace, numbers: Document, file: Path, shown: Shown) -> int:
    """Write the numbers, NaN as null, the picture and the page, and print them or the table with its notes; return 0.

    What is `missing` in the numbers is printed after the notes. Raises OutputError.
    """
    plain = output.finite(numbers)
    with output.writing(file):
        file.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        page = shown.picture.with_suffix(".html")
        if shown.panels:
            save_panels(shown.panels, shown.picture)
        page.write_text(_page(shown, numbers["missing"]), encoding="utf-8")
    if args.json:
        print(json.dumps(plain, allow_nan=False))
        return 0
    Console(width=_WIDTH, highlight=False, markup=False).print(shown.table)
    for line in shown.notes:
        print(line)
    print_missing(numbers["missing"])
    print(page)
    return 0


def _page(shown: Shown, missing: Iterable[str]) -> str:
    """Return the results as a page: the panels, the table, the notes."""
    heads = [str(column.header) for column in shown.table.columns]
    rows = zip(*([str(cell) for cell in column.cells] for column in shown.table.columns), strict=True)
    parts = (
        f"<h1>{escape(shown.title)}</h1>",
        warnings([*shown.notes, *(f"missing: {line}" for line in missing)]),
        drawn(shown.panels),
        "<h2>In numbers</h2>",
        table(shown.title, heads, rows) if any(heads) else facts(rows),
    )
    return document(shown.title, parts, "ol.events li{grid-template-columns:10px 1fr} td{white-space:normal}")


def print_missing(lines: Iterable[str], file: TextIO | None = None) -> None:
    """Print what is not in a bag and should be, to standard output by default."""
    for line in lines:
        print(f"missing: {line}", file=file)
