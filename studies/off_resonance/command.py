# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies off-resonance`: random systems off resonance, the methods beside brute force."""

import argparse
import json
from dataclasses import asdict

from rich.console import Console

from atpid_common.arguments import whole
from atpid_sim.display import counting
from studies.off_resonance.measure import compared, modal_systems, systems, table_lines

METHODS = ("direct", "pca")
#: Arguments of the example in the help.
EXAMPLE = "--systems 5 --seed 1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("--systems", type=whole(1, 10_000), default=40, metavar="N", help="how many random systems; default 40")
    add("--seed", type=whole(0, 2**31), default=1, help="of the random systems; default 1")
    add("--modes", action="store_true", help="systems of two and three modes, half of them under a force")
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Compare and print; return 0. Raises NumericalFailure."""
    with counting("systems", args.systems) as count:
        drawn = (modal_systems if args.modes else systems)(args.systems, args.seed)
        done = compared(drawn, METHODS, count)
    if args.json:
        print(json.dumps({"seed": args.seed, "systems": [asdict(one) for one in done]}))
        return 0
    console = Console(width=140, highlight=False, soft_wrap=True)
    for line in table_lines(done, METHODS):
        console.print(line, markup=False)
    for name in METHODS:
        worst = max(done, key=lambda one: one.short(name))
        points = 100.0 * worst.short(name)
        console.print(f"{name}: at worst {points:.1f} points below brute force (f / f_0 = {worst.system.ratio:g})")
    return 0
