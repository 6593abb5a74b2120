# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The options that several commands have: workers, a cluster, accuracy, a table of the results."""

import argparse
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import path_to, real, whole, word
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.integration import FIDELITIES


def add_workers(parser: argparse.ArgumentParser, kind: str = "threads") -> None:
    """Declare --workers and --cluster; kind: what workers of this machine are."""
    parser.add_argument("--workers", type=whole(1, 1000), default=None, metavar="K", help=f"{kind}; default: all cores")
    cluster = "compute on the Dask cluster of this scheduler (optional extra)"
    parser.add_argument("--cluster", "--scheduler", type=word, metavar="ADDRESS", help=cluster)


def workers_of(args: argparse.Namespace) -> Workers:
    """Return what the options name."""
    return Workers(args.workers, args.cluster)


def add_accuracy(parser: argparse.ArgumentParser) -> None:
    """Declare --fidelity and --rtol."""
    levels = "fidelity level; default: the cheapest within the scene's tolerance"
    parser.add_argument("--fidelity", default="auto", choices=("auto", *FIDELITIES), help=levels)
    rtol = "relative tolerance of the integrator; default: as the scene's tolerance asks"
    parser.add_argument("--rtol", type=real(1e-13, 0.1), metavar="R", help=rtol)


def add_table(parser: argparse.ArgumentParser, out: str = "also write the table here") -> None:
    """Declare --out of a table, --force and --json."""
    parser.add_argument("--out", type=path_to(".csv"), metavar="FILE.csv", help=out)
    output.add_force(parser)
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")


def write_table(rows: Sequence[Mapping[str, object]], path: Path | None) -> None:
    """Write rows of the same names as CSV, where a file is given. Raises OutputError."""
    if path is None:
        return
    with output.writing(path), path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
