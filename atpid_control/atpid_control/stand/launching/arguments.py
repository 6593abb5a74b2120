# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The arguments of a launch file: the options of the command that it starts, and that command's words."""

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from atpid_common.arguments import file_path
from atpid_common.errors import InputError, did_you_mean
from atpid_control.stand.launching.options import OPTIONS

#: Options that a launch file always gives: it runs in real time.
_ALWAYS: Mapping[str, tuple[str, ...]] = {"bench": ("--real-time",)}
#: What `launch` and `launch_ros` themselves read, in every launch file.
_OF_LAUNCH = ("emulate_tty", "ros_namespace", "launch-prefix", "launch-prefix-filter")
#: How a yes or no may be written.
_YES, _NO = ("true", "1", "yes", "on"), ("false", "0", "no", "off")


class LaunchArgumentError(InputError):
    """A launch argument that cannot be used; the message is one line: what was given, what is allowed, what to do."""


@dataclass(frozen=True)
class Argument:
    """One argument: `option` is that of the command, "" where it is its operand; `default` None: it must be given."""

    name: str
    option: str
    description: str
    default: str | None
    choices: tuple[str, ...] = ()
    is_flag: bool = False
    is_path: bool = False


def arguments_of(command: str) -> list[Argument]:
    """Return the launch arguments of a command, one for each of its options."""
    parser = argparse.ArgumentParser(add_help=False)
    OPTIONS[command](parser)
    return [
        _argument(action) for action in parser._actions if not {*action.option_strings} & {*_ALWAYS.get(command, ())}
    ]


def _argument(action: argparse.Action) -> Argument:
    is_flag = action.const is True
    default = "false" if is_flag else str(action.default) if action.default is not None else ""
    return Argument(
        name=action.dest,
        option=next(iter(action.option_strings), ""),
        description=str(action.help) % {"default": default},
        default=default if action.option_strings else None,
        choices=tuple(action.choices or ()),
        is_flag=is_flag,
        is_path=action.type is file_path,
    )


def words_of(command: str, given: Mapping[str, str]) -> list[str]:
    """Return the command's words for the values of its launch arguments; what they may be, the command itself checks.

    Raises LaunchArgumentError for a flag that is neither yes nor no.
    """
    options, operands = list(_ALWAYS.get(command, ())), []
    for argument in arguments_of(command):
        text = given.get(argument.name, "")
        text = os.path.expanduser(text) if argument.is_path else text  # as a shell does in --option=~/file
        if argument.is_flag:
            options += [argument.option] if _is_yes(command, argument.name, text or _NO[0]) else []
        elif text in ("", argument.default):
            continue
        elif argument.option:
            options.append(f"{argument.option}={text}")
        else:
            operands.append(text)
    return [command, *options, "--", *operands]


def _is_yes(command: str, name: str, text: str) -> bool:
    if text.lower() not in (*_YES, *_NO):
        given = f"argument {name}: given {text!r}"
        raise LaunchArgumentError(f"{command}.launch.py: {given}; allowed: true or false, also as 1, yes, 0, no")
    return text.lower() in _YES


def check_names(command: str, names: Sequence[str]) -> None:
    """Raise LaunchArgumentError for a name that is not an argument; `ros2 launch` itself ignores such a name."""
    known = [argument.name for argument in arguments_of(command)]
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
