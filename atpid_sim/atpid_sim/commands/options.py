# SPDX-License-Identifier: Apache-2.0
"""The options of every command that runs a batch: workers, a cluster."""

import argparse

from atpid_common.arguments import whole, word
from atpid_sim.simulation.batch import Workers


def add_workers(parser: argparse.ArgumentParser, kind: str = "threads") -> None:
    """Declare --workers and --cluster; kind: what workers of this machine are."""
    parser.add_argument("--workers", type=whole(1, 1000), default=None, metavar="K", help=f"{kind}; default: all cores")
    cluster = "compute on the Dask cluster of this scheduler (optional extra)"
    parser.add_argument("--cluster", "--scheduler", type=word, metavar="ADDRESS", help=cluster)


def workers_of(args: argparse.Namespace) -> Workers:
    """Return what the options name."""
    return Workers(args.workers, args.cluster)
