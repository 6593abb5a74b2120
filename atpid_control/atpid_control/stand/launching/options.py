# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The options of `stand`, `bench` and `replay`, declared once: for the commands, and for the launch files of them.

With the standard library only, beside the project's own modules of which that is true: `ros2 launch` runs in the Python
of the ROS installation, which need not have the project's requirements.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from atpid_common.arguments import file_path, graph_name, positive, real, whole, word
from atpid_common.middleware import HIGHEST_DOMAIN
from atpid_common.real_time import LOOP_PRIORITY
from atpid_control.views.live.address import HOST, PORT

#: The severities of ROS's log.
LEVELS = ("debug", "info", "warn", "error", "fatal")


def add_stand(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the stand."""
    add = parser.add_argument
    add("scene", type=file_path, help="scene file: beam, grain and ceiling (docs/scenes.md)")
    _add_map(parser)
    add("--bag", type=file_path, help="folder of the bag to make; not given: run-<id> in this folder")
    add_devices(parser)
    text = "end by itself after this time of data; default: at Ctrl-C"
    add("--seconds", type=real(0.0, 1e9, "s", above=True), default=math.inf, help=text)
    _add_run(parser, "")


def add_devices(parser: argparse.ArgumentParser) -> None:
    """Declare which devices the stand has, and with which parameters."""
    parser.add_argument("--ni", action="store_true", help="stream the accelerometer on the NI-9230 as well")
    for name, file in (("labjack", "labjack.yaml"), ("ni", "ni.yaml"), ("motor", "motor_serial.yaml")):
        text = f"parameter file of {name}_node; not given: {file} of the package"
        parser.add_argument(f"--{name}-config", type=file_path, metavar="FILE", help=text)
    exciter = "drive the exciter, by this parameter file of excitation_node (docs/excitation_output.md)"
    parser.add_argument("--excitation-config", type=file_path, metavar="FILE", help=exciter)


def add_bench(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the bench."""
    add = parser.add_argument
    add("scene", type=file_path, help="scene file (docs/scenes.md)")
    out = "folder for bag, summary and report; an earlier run is kept; default: %(default)s"
    add("--out", type=file_path, default=Path("out/bench"), help=out)
    _add_map(parser)
    add("--real-time", action="store_true", help="every node its own process, paced by the clock")
    emulated = "real time, with LabJack's own package on a stand-in device and the real firmware on an emulated board"
    add("--emulated-stand", action="store_true", help=emulated)
    priority = "real time: SCHED_FIFO priority of every node where that is allowed, with its memory locked; 0: neither"
    add("--priority", type=whole(0, 99), help=f"{priority}; default: {LOOP_PRIORITY}, with no memory locked")
    _add_run(parser, "real time: ")
    domain = "ROS domain to use; default: in real time ROS_DOMAIN_ID where it is set, else a free one"
    add("--domain", type=whole(0, HIGHEST_DOMAIN), help=domain)


def add_replay(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the replay."""
    add = parser.add_argument
    add("bag", type=file_path, help="folder of the bag")
    out = "folder for the bag of the replay; earlier ones are kept; default: %(default)s"
    add("--out", type=file_path, default=Path("out/again"), help=out)
    add("--rate", type=real(0.0, 1000.0), default=0.0, help="speed against the recording; 0: as fast as possible")
    add("--scene", type=file_path, help="scene to use in place of the one kept in the bag")
    add("--map", type=file_path, help="height map to use in place of the one kept in the bag")
    add("--log-level", choices=LEVELS, help="least severity that the nodes log")
    add("--domain", type=whole(0, HIGHEST_DOMAIN), help="ROS domain to use; default: a free one")


def _add_map(parser: argparse.ArgumentParser) -> None:
    text = "height map; not given: the scene's own, else one that fits, else one made now"
    parser.add_argument("--map", type=file_path, help=text)


def _add_run(parser: argparse.ArgumentParser, when: str) -> None:
    """Declare what stand and bench share; `when`: in which case the bench takes it."""
    add = parser.add_argument
    add_parameters(parser)
    add("--namespace", type=namespace, metavar="NAME", help=f"{when}namespace of all nodes; default: none")
    add("--log-level", choices=LEVELS, help=f"{when}least severity that the nodes log; default: info")
    restarts = "how often, in all, a killed identifier or selector is started again; default: the run ends"
    add("--restarts", type=whole(0, 100), default=0, help=f"{when}{restarts}")
    move = "before the run, move the ceiling by METRES and back; wrong direction, distance or speed ends the run"
    add("--move", type=positive("m"), default=0.0, metavar="METRES", help=f"{when}{move}")
    add("--live", action="store_true", help="show the run in a browser while it goes on, in real time (docs/live.md)")
    host = "address to serve the live page on; another than the loopback needs the token that is printed"
    add("--live-host", type=word, default=HOST, metavar="ADDRESS", help=f"{host}; default: %(default)s")
    port = "TCP port of the live page; default: %(default)s"
    add("--live-port", type=whole(1, 65535), default=PORT, metavar="PORT", help=port)


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Declare the file with values of the user's own."""
    values = "ROS parameter file whose values, for any of the nodes, take the place of those of the packages' files"
    parser.add_argument("--params-file", type=file_path, metavar="FILE", help=values)


def namespace(text: str) -> str:
    """Return a namespace as ROS writes it, /NAME."""
    return f"/{graph_name(text.strip('/'))}"


#: By the name of the command, which is that of the launch file.
OPTIONS: dict[str, Callable[[argparse.ArgumentParser], None]] = {
    "stand": add_stand,
    "bench": add_bench,
    "replay": add_replay,
}
