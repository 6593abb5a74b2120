# SPDX-License-Identifier: Apache-2.0
"""Launch descriptions whose arguments are checked before any node starts and whose nodes all have to run."""

import signal
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription, Substitution
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from atpid_control.launching.arguments import (
    Argument,
    ParameterFile,
    check,
    check_names,
    parameter_file,
)
from atpid_control.launching.supervision import supervision

PACKAGE = "atpid_control"


def describe(launch_file: str, arguments: Sequence[Argument], *entities: Any) -> LaunchDescription:
    """Return the description of `launch_file`: first the check of its arguments, then what it starts."""
    checking = OpaqueFunction(function=_check, args=[Path(launch_file), arguments])
    return LaunchDescription([checking, *map(_declared, arguments), supervision(), *entities])


def config(package: str, name: str) -> PathJoinSubstitution:
    """Return the parameter file `name` that `package` installs."""
    return PathJoinSubstitution([FindPackageShare(package), "config", name])


def text(argument: str) -> ParameterValue:
    """Return a launch argument as a text parameter, whatever it looks like."""
    return ParameterValue(LaunchConfiguration(argument), value_type=str)


def texts(*arguments: str) -> ParameterValue:
    """Return launch arguments as a parameter that is a list of texts."""
    return ParameterValue([[LaunchConfiguration(argument)] for argument in arguments], value_type=list[str])


class ReplayParameters(Substitution):
    """The parameter file for the replay of the bag that the launch arguments name."""

    def __init__(self) -> None:
        super().__init__()
        self._path = ""

    def perform(self, context: LaunchContext) -> str:
        """Write it, for the first of the nodes, and return its path."""
        self._path = self._path or parameter_file(context.launch_configurations)
        return self._path


def _declared(argument: Argument) -> DeclareLaunchArgument:
    default: Any = argument.default
    if isinstance(default, ParameterFile):
        default = config(default.package, default.name)
    choices = list(argument.choices) or None
    return DeclareLaunchArgument(
        argument.name, default_value=default, description=argument.description, choices=choices
    )


def _check(context: LaunchContext, launch_file: Path, arguments: Sequence[Argument]) -> None:
    """Put the values to use in place of those given; LaunchArgumentError ends the launch before its first node."""
    # `launch` gets SIGINT by set_wakeup_fd; a KeyboardInterrupt as well would tear a callback that starts a node
    signal.signal(signal.SIGINT, lambda *_: None)
    if _on_command_line(launch_file):
        check_names(launch_file.name, arguments, [word.partition(":=")[0] for word in context.argv])
    context.launch_configurations.update(check(launch_file.name, arguments, context.launch_configurations))


def _on_command_line(launch_file: Path) -> bool:
    """Return whether `ros2 launch` was asked for this very file, so that every argument given is meant for it.

    Where another launch file includes this one, the arguments on the command line are the other's.
    """
    words = sys.argv[1:]
    by_package = (PACKAGE, launch_file.name) in pairwise(words)
    named = [path for path in map(Path, words) if path.name == launch_file.name and path.exists()]
    return by_package or any(path.samefile(launch_file) for path in named)
