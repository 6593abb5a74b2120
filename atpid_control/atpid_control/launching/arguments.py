# SPDX-License-Identifier: Apache-2.0
"""The arguments of a launch file, checked as a whole before anything is started."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from atpid_control.launching.values import Check, LaunchArgumentError, one_of


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file that a package installs."""

    package: str
    name: str


@dataclass(frozen=True)
class Argument:
    """One argument: `default` None means that it must be given, "" that it may be left out."""

    name: str
    description: str
    check: Check
    default: str | ParameterFile | None = None
    choices: tuple[str, ...] = ()


def any_text(text: str) -> str:
    """Accept everything."""
    return text


def choice(name: str, description: str, default: str, *others: str) -> Argument:
    """Return an argument that is one of a few words."""
    words = (default, *others)
    return Argument(name, description, one_of(*words), default, words)


#: What `launch` and `launch_ros` themselves read, in every launch file.
COMMON = (
    choice("emulate_tty", "whether the nodes print as to a terminal", "false", "true"),
    Argument("ros_namespace", "namespace of all nodes", any_text, ""),
    Argument("launch-prefix", "command before that of each node, from the option of this name", any_text, ""),
    Argument("launch-prefix-filter", "which nodes get that command, from the option of this name", any_text, ""),
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
    known = [argument.name for argument in arguments]
    for name in names:
        if name not in known and name not in [argument.name for argument in COMMON]:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise LaunchArgumentError(f"{launch_file}: unknown argument {name}; {hint}allowed: {', '.join(known)}")
