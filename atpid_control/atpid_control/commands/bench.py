# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control bench SCENE.yaml --out DIR [--real-time]`."""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from atpid_common.arguments import file_path, positive, whole
from atpid_common.output import writing
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_common.waiting import COMPILING, announced
from atpid_control.bench import live_page, outdir
from atpid_control.bench.emulated import commands_emulated, missing_tools, parameters_emulated
from atpid_control.bench.running import commands_of, run_lockstep, run_realtime, shown
from atpid_control.graph import BenchError
from atpid_control.graph.domain import MOST, named_domain, own_domain
from atpid_control.graph.parts import Parameters, parameters_for, write_parameters
from atpid_control.graph.processes import stoppable
from atpid_control.identification import Identifier
from atpid_control.loop.settings import identification_settings
from atpid_control.selection import make_selector
from atpid_control.selection.map_cache import map_for
from atpid_sim.display import working
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import ControlledCeiling, Scene, load_scene

#: The tone of the warm-up: rate [Hz], samples a block, blocks.
_RATE, _BLOCK, _BLOCKS = 1000.0, 50, 60
#: Arguments of the example in the help.
EXAMPLE = "scenes/thesis_4_3.yaml --out out/bench"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, help="scene file (docs/scenes.md)")
    add("--out", type=file_path, required=True, help="folder for bag, summary and report; an earlier run is kept")
    add("--real-time", action="store_true", help="every node its own process, paced by the clock")
    emulated = "real time, with LabJack's own package on a stand-in device and the real firmware on an emulated board"
    add("--emulated-stand", action="store_true", help=emulated)
    priority = "real time: SCHED_FIFO priority of every node where that is allowed, with its memory locked; 0: neither"
    add("--priority", type=whole(0, 99), help=f"{priority}; default: {LOOP_PRIORITY}, with no memory locked")
    restarts = "real time: how often, in all, a killed identifier or selector is started again; default: the run ends"
    add("--restarts", type=whole(0, 100), default=0, help=restarts)
    move = (
        "real time, "
        "before the run: move the ceiling by METRES and back; direction, distance or speed that is wrong ends the run"
    )
    add("--move", type=positive("m"), default=0.0, metavar="METRES", help=move)
    live_page.add_arguments(parser)
    domain = "ROS domain to use; default: in real time ROS_DOMAIN_ID where it is set, else a free one"
    add("--domain", type=whole(0, MOST), help=domain)


def run(args: argparse.Namespace) -> int:
    """Run the bench; return 0. Raises AtpidError."""
    if args.move and not (args.real_time or args.emulated_stand):
        raise BenchError(f"--move: given {args.move:g}; allowed: with --real-time or --emulated-stand")
    live_page.check(args)
    args.real_time |= args.live and not args.emulated_stand  # a page of a run 20 times as fast shows nothing
    if args.priority is not None and not (args.real_time or args.emulated_stand):
        raise BenchError(f"--priority: given {args.priority}; allowed: with --real-time or --emulated-stand")
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
    if args.move:
        parameters["motor_node"]["check_move"] = args.move
    if args.priority is not None:
        for values in parameters.values():
            values |= {"real_time_priority": args.priority, "lock_memory": args.priority > 0}
    if live_page.announced(args):
        parameters["live_node"] = live_page.parameters(args)
    with writing(parameter_file):
        write_parameters(parameters, parameter_file)
    _rehearse(scene, parameters["identifier_node"])
    os.environ["ROS_LOG_DIR"] = str(out / "log")
    paced = args.real_time or args.emulated_stand
    chosen_domain = named_domain() if paced and args.domain is None else args.domain
    with own_domain(chosen_domain) as domain, stoppable(), shown(scene.duration, args.scene.name) as progress:
        try:
            if paced:
                print(f"ROS domain {domain}: listen with ROS_DOMAIN_ID={domain}", file=sys.stderr)
                if refused := refusal(LOOP_PRIORITY if args.priority is None else args.priority):
                    print(f"{refused}; other programs may delay the loop", file=sys.stderr)
                page = [live_page.command(parameter_file)] if "live_node" in parameters else []
                run_realtime([*commands(parameter_file), *page], out / "log", progress, restarts=args.restarts)
            else:
                run_lockstep(parameters, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(stopped(out / "bag")) from None


def _rehearse(scene: Scene, identifier: Mapping[str, Any]) -> None:
    """Compile what the graph needs, or load it, before it starts: on a fresh machine that takes long.

    One block of the scene's plant is computed, and a made-up tone identified with the identifier's parameters. In real
    time every node then finds it in the compiler's cache.
    """
    console = Console(stderr=True)
    with console.status(COMPILING) if console.is_terminal else announced(COMPILING):
        Stream(scene, Plant(scene)).advance(scene.ceiling.heights[0][1], 0.0)
        _identify(scene.frequency_hz, identifier)


def _identify(frequency: float, parameters: Mapping[str, Any]) -> None:
    """Feed a tone that changes, with noise, hum and a gap, so that every path of the identification is taken."""
    trial = Identifier(identification_settings(parameters.__getitem__))
    time = np.arange(_BLOCK * _BLOCKS) / _RATE
    tone = np.where(time < 1.5, 1.0, 1.5) * np.sin(2.0 * np.pi * frequency * time)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(time))
    signal = tone + noise + np.where(time < 2.0, 0.0, 0.05 * np.sin(100.0 * np.pi * time))
    signal[1100:1103] = np.nan
    for first in range(0, len(time), _BLOCK):
        samples = signal[first : first + _BLOCK]
        trial.push(first, _RATE, samples, samples, float(time[first + _BLOCK - 1]))


def stopped(bag: Path) -> str:
    """Return the message of a run that was stopped."""
    if not bag.exists():
        return "stopped before the recording began; there is no bag"
    if not (bag / "metadata.yaml").exists():
        return f"stopped before the end; the bag is not closed: python -m atpid_control.recording repair {bag}"
    return f"stopped before the end; the bag is closed: {bag}"


def _conclude(scene: Scene, out: Path, mode: str) -> int:
    # here, so that the run itself does not wait for the drawing libraries
    from atpid_control.bags import open_bag
    from atpid_control.bench.summary import show, summary_of, write_summary
    from atpid_control.report.make import write_report
    from atpid_control.report.view import view_of

    with working("reading the bag, repeating its stages by simulation"):
        view = view_of(open_bag(out / "bag"))
    summary = summary_of(view, scene, mode)
    with writing(out / "summary.json"):
        write_summary(summary, out / "summary.json")
    show(summary, view, scene, Console(width=max(100, shutil.get_terminal_size().columns), highlight=False))
    with working("drawing the report"):
        made = write_report(view, out)
    print(f"{made.headline}\nbag {out / 'bag'}, summary {out / 'summary.json'}, report {made.page}")
    if view.run.duration < scene.duration - 2.0 * scene.recording.block:
        recorded = f"recorded {view.run.duration:g} s of {scene.duration:g} s"
        raise BenchError(f"{out / 'bag'}: {recorded}; see its last events")
    return 0
