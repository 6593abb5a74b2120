# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bench SCENE.yaml --out DIR [--real-time]`, which bench.launch.py starts in real time."""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console

from atpid_common.files import Document
from atpid_common.middleware import named_domain
from atpid_common.output import writing
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_common.waiting import COMPILING, announced
from atpid_control.identification import Identifier
from atpid_control.loop.settings import identification_settings
from atpid_control.selection.map_cache import map_of_run
from atpid_control.stand import live_page, outdir
from atpid_control.stand.domain import own_domain
from atpid_control.stand.emulated import commands_emulated, parameters_emulated
from atpid_control.stand.launching.options import add_bench as add_arguments
from atpid_control.stand.parameters import BenchError, Parameters, read_parameters, write_parameters
from atpid_control.stand.parts import exciter_of, given_parameters, parameters_for, parts_of
from atpid_control.stand.processes import RESTART_TIME, stoppable
from atpid_control.stand.running import Commands, RosOptions, commands_of, run_realtime, shown
from atpid_driver.emulator import missing_tools
from atpid_sim.display import working
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import Scene, load_scene

__all__ = ["EXAMPLE", "add_arguments", "run"]

#: The tone of the warm-up: rate [Hz], samples a block, blocks.
_RATE, _BLOCK, _BLOCKS = 1000.0, 50, 60
EXAMPLE = "scenes/thesis_4_3.yaml --out out/bench"


def run(args: argparse.Namespace) -> int:
    """Run the bench; return 0. Raises AtpidError."""
    with recorded(args) as scene:
        mode = "emulated stand" if args.emulated_stand else "real time" if args.real_time else "lockstep"
        return _conclude(scene, args.out.resolve(), mode)


@contextmanager
def recorded(args: argparse.Namespace) -> Iterator[Scene]:
    """Run the graph, and hold the folder with its bag meanwhile; yield the scene. Raises AtpidError."""
    live_page.check(args)
    args.real_time |= args.live and not args.emulated_stand  # a page of a run 20 times as fast shows nothing
    if not (args.real_time or args.emulated_stand):
        for name in ("move", "priority", "restarts", "namespace", "log_level"):
            if given := getattr(args, name):
                option = f"--{name.replace('_', '-')}"
                raise BenchError(f"{option}: given {given}; allowed: with --real-time or --emulated-stand")
    given = given_parameters(args)
    scene = load_scene(args.scene)
    for line in scene.warnings():
        print(f"warning: {line}", file=sys.stderr)
    scene_file, out = args.scene.resolve(), args.out.resolve()
    # checked here, before an earlier run is moved or a node started
    exciter_of(scene)
    height_map = map_of_run(scene, args.map and args.map.absolute(), given.get("selector_node", {}).get("method", ""))
    with outdir.of_run(out, scene_file):
        _run_graph(args, scene, (scene_file, height_map, out / "bag"), given, out)
        yield scene


def _run_graph(
    args: argparse.Namespace, scene: Scene, files: tuple[Path, Path | None, Path], given: Parameters, out: Path
) -> None:
    """Run it; files: of the scene, of the height map, and the bag to make; given: values of the user's file."""
    ros = RosOptions.of(args)
    if not args.emulated_stand:
        parameters = parameters_for(scene, *files, lockstep=not args.real_time, given=given)
        _run_nodes(args, scene, out, parameters, lambda file: commands_of(file, parts_of(scene, lockstep=False), ros))
        return
    missing = missing_tools()
    if missing:
        needs = f"it needs {' '.join(missing)} (sudo make avr-tools)"
        print(f"left out: the firmware on its emulated board, a simulated ceiling stands in; {needs}", file=sys.stderr)
    with tempfile.TemporaryDirectory(prefix="atpid-stand-") as folder:
        place, board = Path(folder), not missing
        parameters = parameters_emulated(scene, *files, place, board=board, given=given)
        _run_nodes(args, scene, out, parameters, lambda file: commands_emulated(scene, file, place, ros, board=board))


def _run_nodes(
    args: argparse.Namespace, scene: Scene, out: Path, parameters: Parameters, commands: Callable[[Path], Commands]
) -> None:
    parameter_file = out / "parameters.yaml"
    # the map is stored in the bag, which has to replay the same commands after the map has changed
    chosen = parameters["selector_node"]["map"]
    parameters["recorder_node"]["files"] = [str(parameter_file), *([chosen] if chosen else [])]
    if args.move:
        parameters["motor_node"]["check_move"] = args.move
    if args.priority is not None:
        for values in parameters.values():
            values |= {"real_time_priority": args.priority, "lock_memory": args.priority > 0}
    if args.restarts:
        parameters["supervisor_node"]["restart_time"] = RESTART_TIME
    page = live_page.parts(args)
    for part in page:
        parameters[part.name] = part.configured() | live_page.parameters(args)
    with writing(parameter_file):
        write_parameters(parameters, parameter_file)
    _warm_up_kernels(scene, parameters["identifier_node"])
    os.environ["ROS_LOG_DIR"] = str(out / "log")
    paced = args.real_time or args.emulated_stand
    chosen_domain = named_domain() if paced and args.domain is None else args.domain
    with own_domain(chosen_domain) as domain, stoppable(), shown(scene.duration, args.scene.name) as progress:
        try:
            if paced:
                print(f"ROS domain {domain}: listen with ROS_DOMAIN_ID={domain}", file=sys.stderr)
                if refused := refusal(LOOP_PRIORITY if args.priority is None else args.priority):
                    print(f"{refused}; other programs may delay the loop", file=sys.stderr)
                ros = RosOptions.of(args)
                nodes = [*commands(parameter_file), *commands_of(parameter_file, page, ros)]
                run_realtime(nodes, out / "log", progress, ros, faults=scene.injected)
            else:
                from atpid_control.stand.nodes.composition import run_lockstep  # needs ROS

                run_lockstep(parameters, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(stopped(out / "bag")) from None


def _warm_up_kernels(scene: Scene, identifier: Document) -> None:
    """Compile what the graph needs, or load it, before it starts, so that every node finds it in the cache."""
    console = Console(stderr=True)
    with console.status(COMPILING) if console.is_terminal else announced(COMPILING):
        _advance(scene)
        _identify(scene.frequency_hz, identifier)


def compile_kernels(scene_file: str, identifier_file: str | None = None) -> None:
    """Compile what a scene's plant needs, or with a parameter file what the identification does, as set-up begins."""
    scene = load_scene(Path(scene_file))
    if identifier_file is None:
        _advance(scene)
    else:
        _identify(scene.frequency_hz, read_parameters(Path(identifier_file), ["identifier_node"])["identifier_node"])


def _advance(scene: Scene) -> None:
    Stream(scene, Plant(scene)).advance(scene.ceiling.heights[0][1], 0.0)


def _identify(frequency: float, parameters: Document) -> None:
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
        return f"stopped before the end; the bag is not closed: atpid bag repair {bag}"
    return f"stopped before the end; the bag is closed: {bag}"


def _conclude(scene: Scene, out: Path, mode: str) -> int:
    # here, so that the run itself does not wait for the drawing libraries
    from atpid_control.runs.run import open_run
    from atpid_control.stand.summary import show, summary_of, write_summary
    from atpid_control.views.report.page import write_report
    from atpid_control.views.report.view import headline, view_of

    with working("reading the bag, repeating its stages by simulation"):
        view = view_of(open_run(out / "bag"))
    summary = summary_of(view, scene, mode)
    with writing(out / "summary.json"):
        write_summary(summary, out / "summary.json")
    show(summary, view, scene, Console(width=max(110, shutil.get_terminal_size().columns), highlight=False))
    with working("drawing the report"):
        page = write_report(view, out)
    print(f"{headline(view)}\nbag {out / 'bag'}, summary {out / 'summary.json'}, report {page}")
    if view.run.duration < scene.duration - 2.0 * scene.recording.block:
        recorded = f"recorded {view.run.duration:g} s of {scene.duration:g} s"
        raise BenchError(f"{out / 'bag'}: {recorded}; see its last events")
    return 0
