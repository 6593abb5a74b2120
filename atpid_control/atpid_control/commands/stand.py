# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control stand SCENE`: what stand.launch.py does, without `ros2`."""

import argparse
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from atpid_common import files
from atpid_common.arguments import file_path, positive, whole
from atpid_common.errors import DONE
from atpid_control.bags import check_new
from atpid_control.bench import live_page
from atpid_control.bench.running import keep_running
from atpid_control.graph.parts import LABJACK, LIVE, NODES, SERIAL_MOTOR, SUPERVISOR, Part
from atpid_control.graph.processes import Processes, stoppable
from atpid_control.security import enclave_arguments
from atpid_sim.scene import load_scene

_LARGEST = 1_000_000_000  # of a map or a parameter file; what reads it has limits of its own [bytes]
_NI = Part("atpid_driver", "ni_node", "ni.yaml")
_LOOP = [NODES[name] for name in ("identifier_node", "selector_node", "recorder_node")]
#: Arguments of the example in the help.
EXAMPLE = "scenes/stand_realtime.yaml --map map.npz --bag out/run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments, those of stand.launch.py."""
    parser.add_argument("scene", type=file_path, help="scene file: beam, grain and ceiling (docs/scenes.md)")
    parser.add_argument("--map", type=file_path, help="height map; not given: the one the scene names")
    parser.add_argument("--bag", type=file_path, help="folder of the bag to make; not given: run-<id> in this folder")
    parser.add_argument("--ni", action="store_true", help="stream the accelerometer on the NI-9230 as well")
    restarts = "how often, in all, a killed identifier or selector is started again; default: the stand ends"
    parser.add_argument("--restarts", type=whole(0, 100), default=0, help=restarts)
    move = (
        "before the run: move the ceiling by METRES and back; direction, distance or speed that is wrong ends the run"
    )
    parser.add_argument("--move", type=positive("m"), default=0.0, metavar="METRES", help=move)
    live_page.add_arguments(parser)
    for name, file in (("labjack", LABJACK), ("ni", _NI), ("motor", SERIAL_MOTOR)):
        text = f"parameter file of {file.name}; not given: {file.config} of the package"
        parser.add_argument(f"--{name}-config", type=file_path, metavar="FILE", help=text)


def run(args: argparse.Namespace) -> int:
    """Run the stand until Ctrl-C; return 0. A node that ends by itself is an error.

    Raises NodeDiedError, SceneError and BagError.
    """
    live_page.check(args)
    load_scene(args.scene).refuse_faults("the stand")
    for file in filter(None, (args.map, args.labjack_config, args.ni_config, args.motor_config)):
        files.check(file, _LARGEST)  # before a node is started
    if args.bag is not None:
        check_new(args.bag)
    with (
        tempfile.TemporaryDirectory(prefix="atpid-stand-") as folder,
        suppress(KeyboardInterrupt),
        stoppable(),
        Processes(commands_of(args, Path(folder)), None, restarts=args.restarts) as nodes,
    ):
        keep_running(nodes)
    return DONE


def commands_of(args: argparse.Namespace, folder: Path) -> list[tuple[str, list[str]]]:
    """Return (name, command) of each node, in the order of stopping: the motor first, the recorder last."""
    scene = {"scene": str(args.scene.absolute())}
    supervised = [part.name for part in (SERIAL_MOTOR, LABJACK, *([_NI] if args.ni else []), *_LOOP)]
    nodes: list[tuple[Part, Path | None, dict[str, Any]]] = [
        (SERIAL_MOTOR, args.motor_config, {"supervised": True} | ({"check_move": args.move} if args.move else {})),
        (SUPERVISOR, None, scene | {"nodes": supervised}),
        (LABJACK, args.labjack_config, {}),
        *([(_NI, args.ni_config, {})] if args.ni else []),
        (NODES["identifier_node"], None, {}),
        (NODES["selector_node"], None, scene | {"map": str(args.map.absolute()) if args.map else ""}),
        (NODES["recorder_node"], None, scene | {"bag": str(args.bag.absolute()) if args.bag else ""}),
    ]
    if live_page.announced(args):
        nodes.append((LIVE, None, live_page.parameters(args)))
    return [(part.name, _command(part, file, own, folder)) for part, file, own in nodes]


def _command(part: Part, file: Path | None, own: dict[str, Any], folder: Path) -> list[str]:
    """Return the command of one node: the parameter file given or the package's, and the node's `own` parameters."""
    path = folder / f"{part.name}.yaml"
    path.write_text(yaml.safe_dump({f"/**/{part.name}": {"ros__parameters": own}}) if own else "", encoding="utf-8")
    files = [file or part.config_file, *([path] if own else [])]
    words = [word for name in files for word in ("--params-file", str(name))]
    return [str(part.executable), "--ros-args", *enclave_arguments(part.name), *words]
