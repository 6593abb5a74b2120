# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag import FILE... --out BAG`: measurements made elsewhere as a bag."""

import argparse

from atpid_common.arguments import file_path, real, refuse, text
from atpid_lab.imports.import_files import import_files, readers
from atpid_sim.display import working

EXAMPLE = "measured.csv --out out/measured --channels beam_displacement=Laser:mm support_displacement=Shaker:m:0.002"


def _wanted(given: str) -> tuple[str, str]:
    name, equals, column = given.partition("=")
    if not (name.isidentifier() and equals and column):
        refuse(given, "NAME=COLUMN[:unit[:factor]], such as beam_displacement=Laser:mm")
    return name, column


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add(
        "files",
        type=file_path,
        nargs="+",
        metavar="FILE",
        help=f"of one bag; it ends in {', '.join(sorted(readers()))}",
    )
    add("--out", type=file_path, required=True, metavar="BAG", help="folder of the bag: a new one")
    channels = "take these, named so; a value is factor x column in the unit, which is converted to SI; default: all"
    add("--channels", type=_wanted, nargs="+", default=[], metavar="NAME=COLUMN[:unit[:factor]]", help=channels)
    rate = "the rate of tables without times, or whose times have too few digits: rows count as even"
    add("--rate", type=real(1e-3, 1e7, "Hz"), metavar="HZ", help=rate)
    add("--time", type=text, default="", metavar="COLUMN", help="the column of a table with times; default: time or t")


def run(given: argparse.Namespace) -> int:
    """Import and print what is in the bag, and what was converted or left out; return 0. Raises BagError, FileError."""
    with working("importing"):
        channels, notes = import_files(given.files, given.out, given.channels, given.rate, given.time)
    print(*channels, *(f"note: {line}" for line in notes), given.out, sep="\n")
    return 0
