# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies soak SCENE.yaml --hours H --out DIR`: the bench for hours; what grows, what is lost."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from atpid_common.arguments import MOST_SEED, file_path, real, whole
from atpid_common.files import FileError, parse_yaml
from atpid_common.output import writing
from atpid_control.stand import outdir
from atpid_control.stand.errors import BenchError
from atpid_control.stand.processes import stoppable
from atpid_sim.scene import load_scene
from studies.soak.run import Leg, Plan, results, write
from studies.soak.run import run as run_legs
from studies.soak.schedule import leg_mapping, legs_of

#: A leg, and so a bag that is checked and removed, in hours; 0.2 GB.
_LEG = 1.0
#: What a soak may last [h]: a year.
_LONGEST = 8760.0
#: A leg shorter than this shows nothing [h]: 2 s.
_SHORTEST = 2.0 / 3600.0
_FAILED = 1
#: Arguments of the example in the help.
EXAMPLE = "scenes/thesis_4_3.yaml --hours 1 --out out/soak"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add, hours = parser.add_argument, real(_SHORTEST, _LONGEST, "h")
    add(
        "scene",
        type=file_path,
        help="scene whose beam, grain, ceiling and sensors are used; amplitudes up to its largest",
    )
    add("--hours", type=hours, required=True, help="length, in hours of data")
    add("--leg", type=hours, default=_LEG, metavar="HOURS", help=f"length of one run and its bag (default: {_LEG:g})")
    add("--seed", type=whole(0, MOST_SEED), default=1, help="of the schedule (default: 1)")
    add("--out", type=file_path, required=True, help="folder for table, picture and bags; an earlier run is kept")
    add("--real-time", action="store_true", help="every node its own process, paced by the clock")
    add("--faults", type=file_path, help="YAML list of faults to draw from, as in a scene, without `from` and `to`")
    add("--keep", action="store_true", help="keep every bag, not only those that break a rule")


def run(args: argparse.Namespace) -> int:
    """Run the soak; return 0, or 1 where something grows, is lost or breaks a rule. Raises AtpidError."""
    from studies.soak import page

    scene, out = load_scene(args.scene), args.out.resolve()
    legs = [leg for leg in legs_of(args.hours, args.leg) if leg >= 3600.0 * _SHORTEST]
    faults = _faults(args.faults)
    leg_mapping(scene, legs[0], args.seed, 0, faults)  # refused before anything is made
    plan = Plan(scene, legs, args.seed, out, args.real_time, args.keep, faults)
    with outdir.of_run(out, args.scene.resolve()), stoppable():
        soak = run_legs(plan, _print_leg)
        if soak.cleaned:
            print(f"removed at the start: {soak.cleaned} shared-memory segments that no process uses", file=sys.stderr)
        trends = page.trends_of(soak)
        write(results(soak, page.as_json(trends)), out / "soak.json")
        if soak.sampler.samples:
            page.picture(soak, out / "soak.png")
    console = Console(width=110, highlight=False)
    console.print(page.table(trends))
    console.print(page.verdict(soak, trends), soft_wrap=True, markup=False)
    if soak.stopped.startswith("stopped by"):
        raise KeyboardInterrupt(f"{soak.stopped}; what there is: {out / 'soak.json'}")
    return _FAILED if page.failed(soak, trends) else 0


def _print_leg(leg: Leg) -> None:
    for line in leg.findings:
        print(line)
    print(leg.line, flush=True)


def _faults(path: Path | None) -> list[Mapping[str, Any]]:
    if path is None:
        return []
    with writing(path, "--faults"):
        text = path.read_text(encoding="utf-8")
    try:
        listed = parse_yaml(text)
    except FileError:
        listed = None
    if not isinstance(listed, list) or not listed or not all(isinstance(one, Mapping) for one in listed):
        raise BenchError(f"--faults: given {path}; allowed: a YAML list of faults, each with part and kind")
    return listed
