# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The options of `stand`, `bench` and `replay`, declared once: for the commands, and for the launch files of them.

With the standard library only, beside the project's own modules of which that is true: `ros2 launch` runs in the Python
of the ROS installation, which need not have the project's requirements.
"""

import argparse
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from atpid_common.arguments import file_path, graph_name, positive, real, whole, word
from atpid_common.errors import InputError, did_you_mean
from atpid_common.middleware import HIGHEST_DOMAIN
from atpid_common.real_time import LOOP_PRIORITY
from atpid_control.views.live.address import HOST, PORT

#: The severities of ROS's log.
_LEVELS = ("debug", "info", "warn", "error", "fatal")


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
    add("--log-level", choices=_LEVELS, help="least severity that the nodes log")
    add("--domain", type=whole(0, HIGHEST_DOMAIN), help="ROS domain to use; default: a free one")


def _add_map(parser: argparse.ArgumentParser) -> None:
    text = "height map; not given: the scene's own, else one that fits, else one made now"
    parser.add_argument("--map", type=file_path, help=text)


def _add_run(parser: argparse.ArgumentParser, when: str) -> None:
    """Declare what stand and bench share; `when`: in which case the bench takes it."""
    add = parser.add_argument
    add_parameters(parser)
    add("--namespace", type=namespace, metavar="NAME", help=f"{when}namespace of all nodes; default: none")
    add("--log-level", choices=_LEVELS, help=f"{when}least severity that the nodes log; default: info")
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
OPTIONS: Mapping[str, Callable[[argparse.ArgumentParser], None]]
OPTIONS = {"stand": add_stand, "bench": add_bench, "replay": add_replay}
#: Options that a launch file always gives: it runs in real time.
_ALWAYS: Mapping[str, tuple[str, ...]] = {"bench": ("--real-time",)}
#: What `launch` and `launch_ros` themselves read, in every launch file.
_OF_LAUNCH = ("emulate_tty", "ros_namespace", "launch-prefix", "launch-prefix-filter")
#: How a yes or no may be written.
_YES, _NO = ("true", "1", "yes", "on"), ("false", "0", "no", "off")


class LaunchArgumentError(InputError):
    """A launch argument that cannot be used; the message is one line: what was given, what is allowed, what to do."""


def arguments_of(command: str) -> dict[str, argparse.Action]:
    """Return the options of a command by the names of its launch arguments."""
    parser = argparse.ArgumentParser(add_help=False)
    OPTIONS[command](parser)
    always = {*_ALWAYS.get(command, ())}
    return {action.dest: action for action in parser._actions if not always & {*action.option_strings}}


def default_of(option: argparse.Action) -> str | None:
    """Return the default of the launch argument of an option; None: it must be given."""
    if not option.option_strings:
        return None
    if option.const is True:
        return _NO[0]
    return "" if option.default is None else str(option.default)


def words_of(command: str, given: Mapping[str, str]) -> list[str]:
    """Return the command's words for the values of its launch arguments; what they may be, the command itself checks.

    Raises LaunchArgumentError for a flag that is neither yes nor no.
    """
    options, operands = list(_ALWAYS.get(command, ())), []
    for name, option in arguments_of(command).items():
        text = given.get(name, "")
        text = os.path.expanduser(text) if option.type is file_path else text  # as a shell does in --option=~/file
        if option.const is True:
            options += [option.option_strings[0]] if _is_yes(command, name, text or _NO[0]) else []
        elif text in ("", default_of(option)):
            continue
        elif option.option_strings:
            options.append(f"{option.option_strings[0]}={text}")
        else:
            operands.append(text)
    return [command, *options, "--", *operands]


def _is_yes(command: str, name: str, text: str) -> bool:
    if text.lower() not in (*_YES, *_NO):
        given = f"argument {name}: given {text!r}"
        raise LaunchArgumentError(f"{command}.launch.py: {given}; allowed: true or false, also as 1, yes, 0, no")
    return text.lower() in _YES


def check_names(command: str, names: Iterable[str]) -> None:
    """Raise LaunchArgumentError for a name that is not an argument; `ros2 launch` itself ignores such a name."""
    known = list(arguments_of(command))
    for name in names:
        if name not in [*known, *_OF_LAUNCH]:
            hint = did_you_mean(name, known)
            allowed = f"allowed: {', '.join(known)}"
            raise LaunchArgumentError(f"{command}.launch.py: unknown argument {name}{hint}; {allowed}")


def is_asked_for(launch_file: Path, words: Sequence[str]) -> bool:
    """Return whether the `words` of `ros2 launch` ask for this very file, so that every argument is meant for it.

    Where another launch file includes this one, the arguments on the command line are the other's.
    """
    named = [path for path in map(Path, words) if path.name == launch_file.name]
    return any(path.samefile(launch_file) if path.exists() else path.parent == Path() for path in named)
