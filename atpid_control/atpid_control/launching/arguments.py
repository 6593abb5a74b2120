# SPDX-License-Identifier: Apache-2.0
"""The arguments of the launch files, checked before anything is started, and what starts their nodes."""

import atexit
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from atpid_common.errors import InputError
from atpid_common.suggestion import did_you_mean

#: A check: takes the text that was given, returns the text to use.
Check = Callable[[str], str]


class LaunchArgumentError(InputError):
    """A launch argument that cannot be used; the message is one line: what was given, what is allowed, what to do."""


def absolute(text: str) -> Path:
    """Return the absolute path of `text`: relative to the current folder, `~` and `~user` expanded."""
    try:
        return Path(os.path.abspath(Path(text).expanduser()))
    except RuntimeError:  # no such user
        raise LaunchArgumentError(f"given {text!r}; there is no such user, write the path without ~") from None


def existing_file(text: str) -> str:
    """Check that `text` is a file that can be read; return its absolute path."""
    path = absolute(text)
    if not os.path.exists(path):
        raise LaunchArgumentError(f"{path} does not exist; give a file")
    if not os.path.isfile(path):
        raise LaunchArgumentError(f"{path} is not a file; give a file")
    if not os.access(path, os.R_OK):
        raise LaunchArgumentError(f"{path} cannot be read; change its permissions or give another file")
    return str(path)


def existing_bag(text: str) -> str:
    """Check that `text` is a closed bag, given as its folder or its .mcap file; return its absolute path."""
    path = absolute(text)
    if not os.path.exists(path):
        raise LaunchArgumentError(f"{path} does not exist; give the folder of a bag")
    if os.path.isfile(path) and path.suffix == ".mcap":
        return existing_file(text)
    if not os.path.isdir(path):
        raise LaunchArgumentError(f"{path} is not a bag; give the folder of a bag, or its .mcap file")
    if not os.path.isfile(path / "metadata.yaml"):
        raise LaunchArgumentError(
            f"{path} has no metadata.yaml, so it is not a bag, or its recording was not closed; "
            f"python -m atpid_control.recording repair {path} closes one"
        )
    return str(path)


def new_folder(text: str) -> str:
    """Check that a folder can be made at `text`: it does not exist, and the nearest folder above it can be written."""
    path = absolute(text)
    if os.path.lexists(path):
        raise LaunchArgumentError(f"{path} exists already, and a bag is never overwritten; give another folder")
    parent = next(folder for folder in path.parents if os.path.lexists(folder))
    if not os.path.isdir(parent) or not os.access(parent, os.W_OK | os.X_OK):
        raise LaunchArgumentError(f"{path} cannot be made: {parent} is not a folder you may write to; give another one")
    return str(path)


def number(lowest: float, highest: float) -> Check:
    """Return a check for a finite number from `lowest` to `highest`."""

    def check(text: str) -> str:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            raise LaunchArgumentError(f"given {text!r}; allowed: a number from {lowest:g} to {highest:g}")
        return repr(value)

    return check


def one_of(*choices: str) -> Check:
    """Return a check for one of `choices`."""

    def check(text: str) -> str:
        if text not in choices:
            raise LaunchArgumentError(f"given {text!r}; allowed: {' or '.join(choices)}")
        return text

    return check


@dataclass(frozen=True)
class Argument:
    """One argument: `default` None means that it must be given, "" that it may be left out."""

    name: str
    description: str
    check: Check
    default: str | None = None
    choices: tuple[str, ...] = ()
    file: str = ""  # the parameter file of atpid_driver that is the default


def choice(name: str, description: str, default: str, *others: str) -> Argument:
    """Return an argument that is one of a few words."""
    words = (default, *others)
    return Argument(name, description, one_of(*words), default, words)


#: What `launch` and `launch_ros` themselves read, in every launch file.
COMMON = (
    choice("emulate_tty", "whether the nodes print as to a terminal", "false", "true"),
    Argument("ros_namespace", "namespace of all nodes", str, ""),
    Argument("launch-prefix", "command before that of each node, from the option of this name", str, ""),
    Argument("launch-prefix-filter", "which nodes get that command, from the option of this name", str, ""),
)


def check(launch_file: str, arguments: Sequence[Argument], given: Mapping[str, str]) -> dict[str, str]:
    """Return the values to use for what was `given`; arguments that were left out are left out here as well.

    Raises LaunchArgumentError for the first argument that is missing or has an impossible value.
    """
    values = {}
    for argument in (*arguments, *COMMON):
        text = given.get(argument.name, "")
        if text:
            try:
                values[argument.name] = argument.check(text)
            except LaunchArgumentError as error:
                raise LaunchArgumentError(f"{launch_file}: argument {argument.name}: {error}") from None
        elif argument.default is None:
            raise LaunchArgumentError(f"{launch_file}: argument {argument.name} is missing: {argument.description}")
    return values


def check_names(launch_file: str, arguments: Sequence[Argument], names: Sequence[str]) -> None:
    """Raise LaunchArgumentError for a name that is not an argument; `ros2 launch` itself ignores such a name."""
    known, common = ([argument.name for argument in group] for group in (arguments, COMMON))
    for name in names:
        if name not in [*known, *common]:
            hint = did_you_mean(name, known)
            raise LaunchArgumentError(f"{launch_file}: unknown argument {name}{hint}; allowed: {', '.join(known)}")


#: What starts a node. SIGINT, SIGTERM and SIGHUP are blocked until the node handles them, so that Ctrl-C while Python
#: starts is neither lost nor a traceback. A node is sent SIGTERM if its launch dies, so that it
#: does not go on moving the ceiling.
START = "env --block-signal=INT --block-signal=TERM --block-signal=HUP setpriv --pdeathsig TERM"
_BAG = Argument("bag", "folder of the bag to make; not given: run-<id> in the current folder", new_folder, "")
_RATE = "speed relative to the recording, from 0 to 1000; 0: as fast as the loop answers"
_MAP = Argument("map", "height map; not given: the one the scene names", existing_file, "")


def _parameters(name: str, description: str, file: str) -> Argument:
    return Argument(name, f"parameter file: {description}", existing_file, "", file=file)


def port(text: str) -> str:
    """Check that `text` is a TCP port to listen on, or 0 for a free one."""
    if not text.isdecimal() or int(text) > 65535:
        raise LaunchArgumentError(f"given {text!r}; allowed: 1 to 65535, or 0 for a free one")
    return str(int(text))


#: Of the live page (docs/live.md).
LIVE = (
    choice("live", "whether to serve the live page", "false", "true"),
    Argument("live_host", "address of the live page; another than the loopback needs the token it prints", str,
             "127.0.0.1"),
    Argument("live_port", "TCP port of the live page", port, "8420"),
)  # fmt: skip

BENCH = (
    Argument("scene", "scene file (docs/scenes.md)", existing_file),
    _MAP,
    _BAG,
    _parameters("motor_config", "limits and speed of the ceiling; those of the scene must agree", "motor.yaml"),
    *LIVE,
)

STAND = (
    Argument("scene", "scene file: beam, grain and ceiling (docs/scenes.md)", existing_file),
    _MAP,
    _BAG,
    choice("ni", "whether to stream the accelerometer on the NI-9230 as well", "false", "true"),
    _parameters("labjack_config", "channels and calibrations of the LabJack T7", "labjack.yaml"),
    _parameters("ni_config", "channels and calibrations of the NI-9230", "ni.yaml"),
    _parameters("motor_config", "serial port, limits and speed of the ceiling's motor", "motor_serial.yaml"),
    *LIVE,
)

REPLAY = (
    Argument("bag", "folder of the bag to play", existing_bag),
    Argument("scene", "scene file; not given: the one kept in the bag", existing_file, ""),
    Argument("map", "height map; not given: the one kept in the bag", existing_file, ""),
    Argument("rate", _RATE, number(0.0, 1000.0), "1.0"),
    Argument("record", "folder of the bag to make of the replay; not given: no bag is made", new_folder, ""),
)


#: Launch arguments that are options of `replay_files`, where they are given.
OPTIONS = ("scene", "map", "rate", "record")


def parameter_file(arguments: Mapping[str, str]) -> str:
    """Write the scene, the map and the parameters of the bag to a folder that is removed when the launch ends.

    By the executable `replay_files`: `ros2 launch` runs in a Python that need not have what reading a bag needs.

    Returns the path of the parameter file; prints on standard error where the replay differs from the run. Raises
    LaunchArgumentError with the reason where the bag cannot be replayed.
    """
    # imported here: the checks above need the standard library only
    from ament_index_python.packages import get_package_prefix

    folder = tempfile.mkdtemp(prefix="atpid-replay-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    executable = Path(get_package_prefix("atpid_control")) / "lib" / "atpid_control" / "replay_files"
    options = [f"--{name}={arguments[name]}" for name in OPTIONS if arguments.get(name)]
    command = [str(executable), arguments["bag"], "--out", folder, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise LaunchArgumentError(f"replay.launch.py: {reason.removeprefix('error: ')}")
    print(done.stderr, end="", file=sys.stderr)
    return done.stdout.strip()
