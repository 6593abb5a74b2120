# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid learn`: train the learned selector from simulated systems; its errors on those left out."""

import argparse
from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, whole
from atpid_control.selection import learning
from atpid_control.selection.height_model import MOST_SYSTEMS, HeightModel
from atpid_sim.display import counting

#: Fewest systems a model is trained with.
_FEWEST = 32
#: Name of the model's file.
_FILE = "heights.npz"
#: Arguments of the example in the help.
EXAMPLE = "--systems 1024 --out out/learned"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help=f"folder {_FILE} is written to")
    parser.add_argument(
        "--systems", type=whole(_FEWEST, MOST_SYSTEMS), default=1024, metavar="N", help="systems drawn; default: 1024"
    )


def run(args: argparse.Namespace) -> int:
    """Train, write the model and print its errors; return 0. Raises OutputError, NumericalFailure."""
    file = output.folder(args.out) / _FILE
    inputs = learning.draw(args.systems)
    with counting("systems", len(inputs)) as count:
        trained = learning.train(inputs, count)
    with counting("errors", sum(int(group.sum()) for group in learning.groups(trained).values())) as count:
        model = learning.with_errors(trained, count)
    model.save(file)
    console = Console(width=150, highlight=False, markup=False)
    console.print(_table(model))
    print(file)
    return 0


def _table(model: HeightModel) -> Table:
    errors = ("error of the clearance", "above the best", "efficiency given up", "error of the amplitude")
    title = f"trained on {len(model.inputs)} systems"
    shown = Table("left out", "systems", *errors, box=SIMPLE_HEAD, pad_edge=False, title=title)
    for row in model.errors:
        clearance, lost, amplitude = (_quantiles(row[name]) for name in ("clearance", "lost", "amplitude"))
        above = f"{100.0 * row['above']:.0f} %"
        shown.add_row(row["left_out"], str(row["systems"]), clearance, above, lost, amplitude)
    return shown


def _quantiles(values: Sequence[float]) -> str:
    """Return a median and a 95th percentile in words."""
    median, high = (f"{100.0 * value:.1f} %" for value in values)
    return f"{median}, 5 % above {high}"
