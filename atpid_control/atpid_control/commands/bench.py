# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control bench SCENE.yaml --out DIR [--real-time]`."""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from atpid_common.output import writing
from atpid_control.bench import outdir
from atpid_control.bench.emulated import commands_emulated, missing_tools, parameters_emulated
from atpid_control.bench.rehearsal import rehearse
from atpid_control.bench.running import commands_of, run_lockstep, run_realtime, shown
from atpid_control.graph.domain import named_domain, own_domain
from atpid_control.graph.parts import Parameters, parameters_for, write_parameters
from atpid_control.graph.processes import stoppable
from atpid_control.selection import make_selector
from atpid_control.selection.map_cache import map_for
from atpid_sim.display import working
from atpid_sim.scene import ControlledCeiling, Scene, load_scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=Path, help="scene file (docs/scenes.md)")
    add("--out", type=Path, required=True, help="folder for bag, summary and report; an earlier run is kept")
    add("--real-time", action="store_true", help="every node its own process, paced by the clock")
    emulated = "real time, with LabJack's own package on a stand-in device and the real firmware on an emulated board"
    add("--emulated-stand", action="store_true", help=emulated)
    domain = "ROS domain to use; default: in real time ROS_DOMAIN_ID where it is set, else a free one"
    add("--domain", type=int, help=domain)


def run(args: argparse.Namespace) -> int:
    """Run the bench; return 0. Raises AtpidError."""
    scene = load_scene(args.scene)
    for line in scene.warnings():
        print(f"warning: {line}", file=sys.stderr)
    scene_file, out = args.scene.resolve(), args.out.resolve()
    height_map = map_for(scene)
    if isinstance(scene.ceiling, ControlledCeiling):
        # checked here, before an earlier run is moved or a node started
        make_selector(scene.ceiling.controller, scene, height_map)
    with outdir.of_run(out, scene_file):
        _run_graph(args, scene, scene_file, height_map, out)
        mode = "emulated stand" if args.emulated_stand else "real time" if args.real_time else "lockstep"
        return _conclude(scene, out, mode)


def _run_graph(args: argparse.Namespace, scene: Scene, scene_file: Path, height_map: Path | None, out: Path) -> None:
    if not args.emulated_stand:
        parameters = parameters_for(scene, scene_file, height_map, out / "bag", lockstep=not args.real_time)
        _run_nodes(args, scene, out, parameters, commands_of)
        return
    missing = missing_tools()
    if missing:
        needs = f"it needs {' '.join(missing)} (sudo make avr-tools)"
        print(f"left out: the firmware on its emulated board, a simulated ceiling stands in; {needs}", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="atpid-stand-") as folder:
        place, board = Path(folder), not missing
        parameters = parameters_emulated(scene, scene_file, height_map, out / "bag", place, board=board)
        _run_nodes(args, scene, out, parameters, lambda file: commands_emulated(file, place, board=board))


def _run_nodes(
    args: argparse.Namespace, scene: Scene, out: Path, parameters: Parameters,
    commands: Callable[[Path], list[tuple[str, list[str]]]],
) -> None:  # fmt: skip
    parameter_file = out / "parameters.yaml"
    # the map is stored in the bag, which has to replay the same commands after the map has changed
    chosen = parameters["selector_node"]["map"]
    parameters["recorder_node"]["files"] = [str(parameter_file), *([chosen] if chosen else [])]
    with writing(parameter_file):
        write_parameters(parameters, parameter_file)
    rehearse(scene, parameters["identifier_node"])
    os.environ["ROS_LOG_DIR"] = str(out / "log")
    paced = args.real_time or args.emulated_stand
    chosen_domain = named_domain() if paced and args.domain is None else args.domain
    with own_domain(chosen_domain) as domain, stoppable(), shown(scene.duration, args.scene.name) as progress:
        try:
            if paced:
                print(f"ROS domain {domain}: listen with ROS_DOMAIN_ID={domain}", file=sys.stderr)
                run_realtime(commands(parameter_file), out / "log", progress)
            else:
                run_lockstep(parameters, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(stopped(out / "bag")) from None


def stopped(bag: Path) -> str:
    """Return the message of a run that was stopped."""
    if not bag.exists():
        return "stopped before the recording began; there is no bag"
    if not (bag / "metadata.yaml").exists():
        return f"stopped before the end; the bag is not closed: python -m atpid_control.recording repair {bag}"
    return f"stopped before the end; the bag is closed: {bag}"


def _conclude(scene: Scene, out: Path, mode: str) -> int:
    # here, so that the run itself does not wait for the drawing libraries
    from atpid_control.bench.summary import show, summary_of, write_summary
    from atpid_control.report.make import write_report
    from atpid_control.report.view import view_of

    with working("reading the bag, repeating its stages by simulation"):
        view = view_of(out / "bag")
    summary = summary_of(view, scene, mode)
    with writing(out / "summary.json"):
        write_summary(summary, out / "summary.json")
    show(summary, view, scene, Console(width=max(100, shutil.get_terminal_size().columns), highlight=False))
    with working("drawing the report"):
        made = write_report(view, out)
    print(f"{made.headline}\nbag {out / 'bag'}, summary {out / 'summary.json'}, report {made.page}")
    return 0
