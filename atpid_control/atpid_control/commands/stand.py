# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid stand SCENE`, which stand.launch.py starts as well, and `atpid live`, the page of nodes that run already."""

import argparse
import math
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from atpid_common.arguments import file_path, graph_name, whole, word
from atpid_common.cli import Command
from atpid_common.errors import DONE
from atpid_common.middleware import named_domain
from atpid_control.runs.writer import check_new
from atpid_control.selection.map_cache import map_of_run
from atpid_control.stand import live_page, parts
from atpid_control.stand.launching.options import add_stand as add_arguments
from atpid_control.stand.parameters import Parameters, combined, write_parameters
from atpid_control.stand.processes import RESTART_TIME, Processes, stoppable
from atpid_control.stand.running import RosOptions, commands_of, keep_running
from atpid_control.supervision.limits import QUANTITIES
from atpid_control.views.live.address import HOST, PORT
from atpid_sim.scene import Scene, load_scene

__all__ = ["EXAMPLE", "LIVE", "add_arguments", "run"]

NO_LEVELS = (
    "no abort level is set: however far the beam moves, the motor stays on; "
    "set those of your stand for supervisor_node with --params-file (docs/graph.md, Levels)"
)
EXAMPLE = "scenes/stand_realtime.yaml --map map.npz --bag out/run"


def run(args: argparse.Namespace) -> int:
    """Run the stand until Ctrl-C, or for the time asked for; return 0. A node that ends by itself is an error.

    Raises NodeDiedError, SceneError and BagError.
    """
    live_page.check(args)
    named_domain()
    scene = load_scene(args.scene)
    scene.refuse_faults("the stand")
    if args.bag is not None:
        check_new(args.bag)
    # in the order of stopping: what moves first, the recorder last
    devices, moving = parts.devices_of(args), 2 if args.excitation_config else 1
    nodes = [*devices[:moving], parts.SUPERVISOR, *devices[moving:], *parts.LOOP, *live_page.parts(args)]
    ros = RosOptions.of(args)
    with suppress(KeyboardInterrupt), stoppable(), tempfile.TemporaryDirectory(prefix="atpid-stand-") as folder:
        file = Path(folder) / "parameters.yaml"
        parameters = _parameters(args, scene, nodes, file)
        if all(math.isinf(parameters[parts.SUPERVISOR.name].get(f"{name}_abort", math.inf)) for name in QUANTITIES):
            print(NO_LEVELS, file=sys.stderr)
        write_parameters(parameters, file)
        with Processes(commands_of(file, nodes, ros), None, restarts=ros.restarts) as running:
            keep_running(running, ros.namespace, args.seconds)
    return DONE


def _parameters(args: argparse.Namespace, scene: Scene, nodes: list[parts.Part], file: Path) -> Parameters:
    """Return what each node starts with, which the recorder keeps from `file`, with the map."""
    given = parts.given_parameters(args)
    usual = parts.usual_parameters(nodes, scene)
    method = given.get("selector_node", {}).get("method", "")
    height_map = map_of_run(scene, args.map and args.map.absolute(), method)
    kept = [str(path) for path in (file, height_map) if path]
    bag = str(args.bag.absolute()) if args.bag else ""
    own = parts.stand_parameters(nodes, args.scene, height_map)
    own["motor_node"] |= {"check_move": args.move} if args.move else {}
    own["supervisor_node"]["restart_time"] = RESTART_TIME if args.restarts else 0.0
    own["recorder_node"] = {"scene": str(args.scene.absolute()), "bag": bag, "files": kept}
    own["live_node"] = live_page.parameters(args)
    return combined(usual, own, given)


def _live_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    scene = "for the efficiency and the size of the grain; default: neither is shown"
    add("--scene", type=file_path, metavar="SCENE.yaml", help=scene)
    add("--host", type=word, default=HOST, metavar="ADDRESS", help=f"where to serve it; default {HOST}")
    add("--port", type=whole(0, 65535), default=PORT, metavar="N", help=f"0: a free one; default {PORT}")
    add("--namespace", type=graph_name, metavar="NAME", help="of the nodes; default: none")


LIVE = Command(_live_arguments, live_page.serve, "--scene scenes/thesis_4_3.yaml --port 8080")
