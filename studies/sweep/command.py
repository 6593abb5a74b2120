# SPDX-License-Identifier: Apache-2.0
"""`python -m studies sweep`: the standard task at many heights on all cores: simulations a second, worst ledger."""

import argparse
import json

from atpid_common.arguments import real, whole
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.simulation.batch import cores
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import FIDELITIES
from studies.journal_option import add_journal
from studies.sweep.measure import standard_task, sweep

#: Heights at most: their results fill the memory from there on.
_MOST_POINTS = 100_000
#: Arguments of the example in the help.
EXAMPLE = "--points 500 --fidelity impact"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    span = "heights from 0.02 to 0.4 m"
    parser.add_argument(
        "--points", type=whole(1, _MOST_POINTS), default=2000, metavar="N", help=f"{span}; default 2000"
    )
    parser.add_argument(
        "--rtol", type=real(1e-13, 0.1), default=1e-6, metavar="R", help="relative tolerance; default 1e-6"
    )
    levels = "fidelity level; default: the cheapest whose model error is at most --rtol"
    parser.add_argument("--fidelity", default="auto", choices=("auto", *FIDELITIES), help=levels)
    add_workers(parser)
    add_journal(parser)


def run(args: argparse.Namespace) -> int:
    """Run the sweep and print one JSON object; return 0. Raises NumericalFailure."""
    task, workers = standard_task(0.01, 0.1, 0.2), workers_of(args)
    choice = choose(task.with_(tolerance=args.rtol), args.fidelity)
    with counting("heights", args.points) as count:
        done = sweep(task, 0.02, 0.4, args.points, args.rtol, choice.fidelity, count, workers, args.journal)
    best = int(done.amplitudes.argmin())
    result = {
        "points": args.points,
        "cores": cores(),
        "fidelity": choice.fidelity,
        "model_error": choice.model_error,
        "wall_s": done.wall_s,
        "simulations_per_second": done.computed / done.wall_s,
        "integration_ms": 1e3 * float(done.integration_s.mean()),
        "largest_energy_residual": done.residual,
        "best_height": float(done.heights[best]),
        "best_amplitude": float(done.amplitudes[best]),
    }
    print(json.dumps(result, indent=1))
    return 0
