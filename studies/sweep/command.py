# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies sweep`: the standard task at many heights on all cores: simulations a second, worst ledger."""

import argparse
import json
import time
from typing import Any

from atpid_common.arguments import MOST_SEED, real, whole
from atpid_dynamics.over_heights import over_heights
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import Workers, cores
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import FIDELITIES
from atpid_sim.system import Array
from studies.journal_option import add_journal
from studies.sweep.measure import standard_task, sweep
from studies.sweep.steady import compared, random_system

#: Heights at most: their results fill the memory from there on.
_MOST_POINTS = 100_000
#: Repetitions of which the fastest counts: other programs only ever make one slower.
_REPEATED = 3
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
    steady = "find the steady motions as `atpid sweep` does, beside the runs in full, and judge both by long runs"
    parser.add_argument("--steady", action="store_true", help=steady)
    systems = "with --steady: those of so many random systems at 64 heights each, in place of the standard task"
    parser.add_argument("--systems", type=whole(1, 10_000), metavar="N", help=systems)
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="S", help="of --systems; default: 1")
    add_workers(parser)
    add_journal(parser)


def run(args: argparse.Namespace) -> int:
    """Run the sweep and print one JSON object; return 0. Raises NumericalFailure."""
    task, workers = standard_task(0.01, 0.1, 0.2), workers_of(args)
    if args.steady and args.systems:
        with counting("systems", args.systems) as count:
            for number in range(args.systems):
                print(json.dumps(random_system(args.seed, number, args.rtol, args.fidelity, workers)), flush=True)
                count(number + 1)
        return 0
    choice = choose(task.with_(tolerance=args.rtol), args.fidelity)
    with counting("heights", args.points) as count:
        done = sweep(task, 0.02, 0.4, args.points, args.rtol, choice.fidelity, count, workers, args.journal)
    best = int(done.amplitudes.argmin())
    steady = _steady(task, done.heights, choice.fidelity, args.rtol, workers) if args.steady else {}
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
        **steady,
    }
    print(json.dumps(result, indent=1))
    return 0


def _steady(task: Scene, heights: Array, fidelity: str, rtol: float, workers: Workers) -> dict[str, Any]:
    """Return the speed of the same heights' steady motions, the best of three, and how they are judged."""
    walls = []
    for _ in range(_REPEATED):
        begin = time.perf_counter()
        (found,) = over_heights([task], heights, fidelity, rtol, workers)
        walls.append(time.perf_counter() - begin)
    with counting("judged", len(heights)) as count:
        judged = compared(task, found, workers, count)
    return {"steady_per_second": len(heights) / min(walls), "steady": judged, "how": found.sentence}
