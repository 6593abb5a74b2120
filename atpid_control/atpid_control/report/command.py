# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control report BAG --out DIR`."""

from __future__ import annotations

import argparse
from pathlib import Path

from atpid_control.report.make import report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("bag", type=Path, help="folder of the bag")
    parser.add_argument("--out", type=Path, required=True, help="folder for report.html and the pictures")


def run(args: argparse.Namespace) -> int:
    """Make the report; return the exit status."""
    made = report(args.bag, args.out)
    print(made.headline)
    print(made.page)
    return 0
