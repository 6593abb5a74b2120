# SPDX-License-Identifier: Apache-2.0
"""What commands with a picture and numbers have in common: a folder for both, a table or JSON on the terminal."""

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_sim.simulation.simulate import finite

_WIDTH = 110


class Shown(NamedTuple):
    """What a command shows of its results."""

    table: Table
    notes: Iterable[str]  # a line each
    picture: Path


def add_results(parser: argparse.ArgumentParser, what: str = "picture and numbers") -> None:
    """Declare `--out`, `--force` and `--json`."""
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help=f"folder for {what}")
    output.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def claim(args: argparse.Namespace, *names: str) -> list[Path]:
    """Return the files of these names in `--out`, before the work. Raises OutputError: they cannot be written."""
    output.folder(args.out)
    return [output.file(args.out / name, replace=args.force) for name in names]


def give(args: argparse.Namespace, numbers: Mapping[str, Any], file: Path, shown: Shown) -> int:
    """Write the numbers, NaN as null, and print them or the table with its notes; return 0. Raises OutputError."""
    plain = finite(dict(numbers))
    with output.writing(file):
        file.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if args.json:
        print(json.dumps(plain, allow_nan=False))
        return 0
    Console(width=_WIDTH, highlight=False, markup=False).print(shown.table)
    for line in shown.notes:
        print(line)
    print(shown.picture)
    return 0
