# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid first-run SCENE`: the first measurement of a stand, step by step, beside what its scene expects."""

import argparse
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from atpid_campaign.first_run.steps import Expected, Row, Step, rows_of, steps_of
from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_common.cli import Parser
from atpid_common.errors import AtpidError, InputError
from atpid_control.analysis.signals import signals_of
from atpid_control.commands import bench, stand
from atpid_control.commands.results import Shown, claim, give, two_columns
from atpid_control.runs.run import Run, open_run
from atpid_control.stand.launching.options import add_devices, add_parameters
from atpid_control.stand.parameters import read_parameters, write_parameters
from atpid_control.stand.parts import NAMES, devices_of
from atpid_sim.scene import Scene, load_scene

#: Time that a person has for what the step asks for [s].
_HANDS = 10.0
#: Arguments of the example in the help.
EXAMPLE = "scenes/stand_realtime.yaml --emulated-stand --yes --out out/first_run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, help="scene file with your beam, grain and ceiling (docs/scenes.md)")
    add("--out", type=file_path, default=Path("out/first_run"), help="folder of bags and page; default: %(default)s")
    output.add_force(parser)
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--simulated", action="store_true", help="in place of the stand: the simulated bench")
    kind.add_argument("--emulated-stand", action="store_true", help="or stand-in devices and the real firmware")
    add("--yes", action="store_true", help="ask nothing; allowed where no person has to act: without a stand")
    add("--amplitude", type=positive("m or N"), metavar="A", help="of the excitation; default: the scene's least")
    add("--move", type=positive("m"), default=0.1, metavar="METRES", help="known motion; default: %(default)s")
    add_devices(parser)
    add_parameters(parser)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Make the steps that are not skipped, and the page; return 0, 1 where a figure is not as expected."""
    if args.yes and not (args.simulated or args.emulated_stand):
        raise InputError("--yes: given for a stand; allowed: with --simulated or --emulated-stand; a person has to act")
    expected = Expected(load_scene(args.scene), args.amplitude, args.move)
    picture, file = claim(args, "first_run.png", "first_run.json")
    done: list[tuple[Step, Run | None, list[Row]]] = []
    skipped: list[str] = []
    for step in steps_of(expected):
        answer = "" if args.yes else _asked(step)
        if answer == "q":
            skipped.append(f"stopped before: {step.title}")
            break
        if answer == "s":
            skipped.append(f"skipped: {step.title}")
            continue
        done.append((step, *_measured(args, step, expected)))
        for row in done[-1][2]:
            print(f"{'as expected' if row.right else 'DIFFERS':11}  {row.what}: {row.found}; expected {row.expected}",
                  file=sys.stderr)  # fmt: skip
    panels = [[partial(_draw, step=step, run=run)] for step, run, _ in done if run is not None]
    rows = [(step, row) for step, _, found in done for row in found]
    shown = two_columns((f"{step.title}: {row.what}", f"{row.found}; expected {row.expected}") for step, row in rows)
    notes = [f"not as expected: {row.what}: {row.remedy}" for _, row in rows if not row.right] + skipped
    numbers = {"scene": str(args.scene), "missing": [], "notes": notes,
               "steps": {step.name: [row._asdict() for row in found] for step, _, found in done}}  # fmt: skip
    give(args, numbers, file, Shown(f"First measurement of {args.scene.stem}", shown, notes, picture, panels))
    return int(not all(row.right for _, row in rows))


def _asked(step: Step) -> str:
    """Show what to do, and return "" for going on, "s" for leaving the step out, "q" for the end."""
    print(f"\n{step.title} ({step.duration:.0f} s)\n  {step.task}", file=sys.stderr)
    while True:
        print("  Enter: go on, s: skip, q: stop > ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        answer = line.strip().lower() if line else "q"  # the terminal is gone
        if answer in ("", "s", "q"):
            return answer


def _measured(args: argparse.Namespace, step: Step, expected: Expected) -> tuple[Run | None, list[Row]]:
    """Record a step; return its run and figures. A run that fails is a row that is not right."""
    folder = args.out / step.name
    folder.mkdir(parents=True, exist_ok=True)
    file, parameters = folder / "scene.yaml", folder / "held.yaml"
    scene = _scene(expected.scene, step, devices_of(args)[0].configured())
    file.write_text(yaml.safe_dump(scene.to_mapping(), sort_keys=False), encoding="utf-8")
    given = read_parameters(args.params_file, NAMES) if args.params_file else {}
    given["selector_node"] = given.get("selector_node", {}) | {"hold": True}  # the ceiling stays closed
    write_parameters(given, parameters)
    values = vars(args) | {"scene": file, "params_file": parameters, "move": step.move}
    try:
        if args.simulated or args.emulated_stand:
            bag = folder / "run/bag"
            values |= {"out": bag.parent, "real_time": bool(step.move) and args.simulated}
            with bench.recorded(_options(bench, values)):
                pass
        else:
            bag = folder / f"bag-{len(list(folder.glob('bag-*'))) + 1}"  # an earlier one is kept
            stand.run(_options(stand, values | {"bag": bag, "seconds": step.duration + _HANDS}))
        run = open_run(bag)
        return run, rows_of(step, run, expected)
    except AtpidError as error:
        return None, [Row(step.title, str(error), "a run to its end", False, "docs/first_run.md, By symptom")]


def _options(command: Any, values: Mapping[str, Any]) -> argparse.Namespace:
    """Return the options of another command: its defaults, and of `values` those that it has."""
    parser = Parser()
    command.add_arguments(parser)
    found: argparse.Namespace = parser.parse_args([str(values["scene"])])
    vars(found).update({name: value for name, value in values.items() if name in found})
    return found


def _scene(scene: Scene, step: Step, motor: Mapping[str, Any]) -> Scene:
    """Return the scene of a step: closed, moved by a motor with these parameters, as long as the step."""
    ceiling = scene.ceiling
    low, high, speed = (*ceiling.range, ceiling.speed) if ceiling.controlled else (
        max(motor["lowest"], 2.0 * scene.grain.radius), motor["highest"], motor["speed"])  # fmt: skip
    closed = {"closed": low, "range": [low, high], "speed": speed, "controller": "direct"}
    return scene.with_(
        excitation=dict(step.excitation), ceiling=closed, duration=step.duration, initial=None,
        steady_window=[0.0, step.duration], faults=(),
    )  # fmt: skip


def _draw(ax: Any, step: Step, run: Run) -> None:
    """Draw what the sensors measured in a step, and the ceiling."""
    signals, _ = signals_of(run)
    for name, values, unit in zip(signals.names, (signals.excitation, signals.response), signals.units, strict=True):
        moved = values - np.nanmedian(values)
        ax.plot(signals.time, moved, linewidth=0.7, label=f"{name.replace('_', ' ')} about its median [{unit}]")
    begin = signals.time[0]
    if step.move:  # before the first sample: homing and the known motion
        known = np.isfinite(run.ceiling.height)
        begin = run.ceiling.time[known].min(initial=begin)
        ax.plot(run.ceiling.time, run.ceiling.height, linewidth=1.2, label="ceiling [m]")
    ax.set(title=step.title, xlabel="time [s]", xlim=(begin, signals.time[-1]))
